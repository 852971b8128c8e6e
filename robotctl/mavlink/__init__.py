"""The MAVLink vehicle: services between the robot and its ground stations."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
