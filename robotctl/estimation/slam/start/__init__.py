"""Initial values of an optimisation: odometry, a spanning tree, or relaxed rotations."""
