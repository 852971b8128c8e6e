"""View of a pilot's plan as a message, a few times a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from robotctl.messages.estimation import PlanView
from robotctl.messages.map_message import map_message

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from robotctl.planning.behave.behaviours.outlook import Outlook

_VIEW_NS: Final = 200_000_000
"""Interval between two views [ns]."""
_MOST: Final = 2000
"""Obstacles of a view; of more, every second or third is shown."""


class PlanViews:
    """Makes the views.

    Parameters
    ----------
    ask
        Returns what the pilot drives by; None: there is no pilot.
    """

    def __init__(self, ask: Callable[[], Outlook | None]) -> None:
        self._ask = ask
        self._viewed_ns = -_VIEW_NS

    def of(self, now_ns: int) -> list[PlanView]:
        """Return a view if it is time for one."""
        if now_ns - self._viewed_ns < _VIEW_NS:
            return []
        outlook = self._ask()
        if outlook is None:
            return []
        self._viewed_ns = now_ns
        every = -(-len(outlook.obstacles) // _MOST) or 1
        return [
            PlanView(
                now_ns,
                _packed(outlook.path),
                _packed(outlook.arc),
                _packed(outlook.obstacles[::every]),
                tuple(map(tuple, outlook.moving.tolist())),
                map_message(outlook.costs, now_ns),
            )
        ]


def _packed(places: NDArray[np.float64]) -> bytes:
    return places.astype(np.dtype("<f4")).tobytes()
