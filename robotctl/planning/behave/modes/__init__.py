"""The robot's modes: what steers in each, and how one gives way to another."""
