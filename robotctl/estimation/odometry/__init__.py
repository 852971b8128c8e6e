"""Odometry, its noise and its calibration."""
