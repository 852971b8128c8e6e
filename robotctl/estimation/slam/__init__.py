"""Simultaneous localisation and mapping: one joint estimate of robot and map."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
