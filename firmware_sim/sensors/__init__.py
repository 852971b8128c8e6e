"""Measurements of sonars and lidar in a world."""
