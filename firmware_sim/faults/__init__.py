"""Faults: kinds, catalogue, scenarios, and the monitor that knows the truth."""
