"""Real-time controller for wheeled robots: CAN motor control, MAVLink and on-board estimation."""

from importlib.metadata import version

__version__ = version("robotctl")
