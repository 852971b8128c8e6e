"""The simulated CAN bus (simcan)."""
