"""Drive kinematics and the noise of motion."""
