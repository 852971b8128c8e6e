"""moteus over CAN FD: one motor, velocity by its position mode."""
