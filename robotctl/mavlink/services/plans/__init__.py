"""Missions, fences and rally points."""
