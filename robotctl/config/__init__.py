"""A robot's file: reading, checking and changing it."""
