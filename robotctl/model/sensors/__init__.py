"""Geometry of sensors and their readings."""
