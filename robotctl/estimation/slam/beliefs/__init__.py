"""Gaussian belief propagation: the linear graph, messages around loops, messages on trees."""
