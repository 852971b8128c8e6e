"""Planners by random trees: of points for straight pieces, of poses for curves."""
