"""Replaying a flight record through the control core."""
