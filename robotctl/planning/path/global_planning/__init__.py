"""Paths through a known map: planners from a map to a path, or a reason why there is none."""
