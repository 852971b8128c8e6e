"""Cameras: real ones by OpenCV, and the simulated one."""
