"""Calibrating a camera and judging what it sees."""
