"""Scans that SLAM matches: of a lidar, or local ones made of what other sensors see on some way."""
