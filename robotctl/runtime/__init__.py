"""How steps are run: clock, loop, sockets between processes, recorder, storage."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
