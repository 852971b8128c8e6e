"""What stops the robot: state machine, health, plausibility and arming, pure."""
