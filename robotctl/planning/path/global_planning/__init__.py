"""Paths through a known map: planners from a cost map to a path, or a reason why there is none."""
