"""Behaviours: mission items, wall following, return home, relocalisation."""
