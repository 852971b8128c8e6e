"""What SLAM matches: lidar scans, or local scans made of what other sensors see on some way."""
