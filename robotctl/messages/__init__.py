"""Messages between the parts of robotctl: typed values without behaviour."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
