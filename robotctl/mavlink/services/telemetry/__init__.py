"""What the robot tells."""
