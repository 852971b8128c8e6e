"""What makes the robot move, or stop."""
