"""Measurements that are wrong: robust kernels and graduated non-convexity."""
