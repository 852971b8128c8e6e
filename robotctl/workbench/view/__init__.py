"""Recordings in the page: what the robot published, at any time of a run."""
