"""Scans that SLAM matches: those of a lidar, or local ones gathered along the way."""
