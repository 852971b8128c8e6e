"""Planners by random trees: one engine for straight pieces and for curves."""
