"""What gyro and accelerometer tell of the robot: attitude, turning, rising."""
