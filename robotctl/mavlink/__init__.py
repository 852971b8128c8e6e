"""MAVLink services between the robot and its ground stations."""
