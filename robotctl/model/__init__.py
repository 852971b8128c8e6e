"""Typed, pure maths: poses, drive kinematics, motion and its noise."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
