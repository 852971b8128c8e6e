"""The occupancy grid, its filling and its quality."""
