"""Emulated motor controllers, sensors and room on a CAN bus: an independent oracle for robotctl."""
