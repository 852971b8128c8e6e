"""Paths through a map, and following them."""
