"""What keeps the robot from driving into things."""
