"""Incremental smoothing: the estimate after every pose, at the cost of what changed."""
