"""Knowledge of the world around the robot: what is free, what moves, what it costs."""
