"""Calibrating odometry."""
