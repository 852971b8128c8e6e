"""VESC and drives with its firmware, over CAN: one motor, and the servo output for a steering."""
