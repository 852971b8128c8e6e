"""Real-time controller for wheeled robots: CAN motor control, MAVLink and on-board estimation."""
