"""Goals and missions become velocity commands, without clock or I/O.

Data passes three rooms once, downwards: `map` (what is free, what moves, what it costs), `path`
(finding paths and following them), `behave` (what to do about a goal); `guard` stops the robot.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
