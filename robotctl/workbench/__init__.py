"""Offline work behind the commands: each takes its options and returns a result."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
