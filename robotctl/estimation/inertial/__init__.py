"""Gyro and accelerometer: attitude, rotation, rise."""
