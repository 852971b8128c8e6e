"""Rooms and maps, and where the robot really is in them."""
