"""Telemetry: the robot's state for its stations."""
