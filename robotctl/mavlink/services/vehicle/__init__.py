"""Services that make the robot move, or stop."""
