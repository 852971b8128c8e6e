"""Pure control laws: from a set-point and a measurement to a demand, without clock or I/O."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
