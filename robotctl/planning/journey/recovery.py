"""What a robot does where it cannot go on: a bounded ladder, one rung after the other."""

from __future__ import annotations

import enum
from typing import Final


class Rung(enum.Enum):
    """One try; its value tells people what the robot does."""

    WAIT = "waiting for what is in the way to move"
    REPLAN = "planning again"
    CLEAR = "forgetting obstacles that it does not see now"
    BACK_OFF = "backing off"
    LOOK_AROUND = "looking around"


LADDER: Final = tuple(Rung)
"""All rungs, from the gentlest on."""

_MOST: Final = 4
"""Times that one journey may climb from the ground."""


class Ladder:
    """Counts the tries of one journey, which all together are bounded.

    Trouble after some progress begins with the first rung again. Without progress each trouble
    leads to the next rung; beyond the last one, or on too many climbs, the robot gives up.

    Parameters
    ----------
    can_turn
        Whether the robot turns on the spot; otherwise it cannot look around.

    Attributes
    ----------
    tries
        Rungs taken so far.
    """

    def __init__(self, *, can_turn: bool) -> None:
        self._rungs = [rung for rung in LADDER if can_turn or rung is not Rung.LOOK_AROUND]
        self._at = 0
        self._climbs = 0
        self.tries = 0

    def progress(self) -> None:
        """Take note that the robot has got on: the next trouble begins with the first rung."""
        self._at = 0

    def climb(self) -> Rung | None:
        """Return what to try next; None: nothing is left."""
        if self._at == 0:
            self._climbs += 1
        if self._climbs > _MOST or self._at == len(self._rungs):
            return None
        rung = self._rungs[self._at]
        self._at += 1
        self.tries += 1
        return rung
