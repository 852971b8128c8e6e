"""Where an optimisation begins: odometry, a spanning tree, or relaxed rotations."""
