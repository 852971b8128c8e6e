"""The ports of the runtime on real wires: CAN bus, motor controllers, sensors, MAVLink links."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
