"""People who walked up and stand now, in line or talking, between whom a robot does not go."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

_SAME_M: Final = 0.5
"""Maximum distance between two places of one person in successive scans [m]."""
_UNSEEN_NS: Final = 1_000_000_000
"""Time within which the map shows a person who has stopped [ns]."""
_LIFE_NS: Final = 120_000_000_000
"""Time after which a person who has not moved is forgotten [ns]: it may be a thing."""


class StandingPeople:
    """Places of people who walked and have stopped.

    In a scan a standing person looks like a post, so only people who were seen to walk count. They
    stand for as long as the map shows something where they stopped.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget everybody."""
        self._walked = np.empty((0, 2))
        self._stopped: list[tuple[float, float, int]] = []
        """Places [m], and times at which the people stopped [ns]."""

    def see(
        self,
        moving: NDArray[np.float64],
        is_marked: Callable[[float, float], bool],
        now_ns: int,
    ) -> None:
        """Take a scan.

        Parameters
        ----------
        moving
            (k, 5) what moves, as `LocalSituation.moving`.
        is_marked
            Whether sensors have marked something at a place of `world` [m] that no map explains.
        now_ns
            Time of the scan [ns].
        """
        walk = moving[:, :2]
        gone = [each for each in self._walked.tolist() if not _is_near(each, walk)]
        self._walked = walk
        if not (gone or self._stopped):
            return
        self._stopped = [
            (x_m, y_m, since_ns)
            for x_m, y_m, since_ns in self._stopped
            if not _is_near((x_m, y_m), walk)
            and now_ns - since_ns < _LIFE_NS
            and (now_ns - since_ns < _UNSEEN_NS or is_marked(x_m, y_m))
        ]
        for x_m, y_m in gone:
            if not _is_near((x_m, y_m), self.places):
                self._stopped.append((x_m, y_m, now_ns))

    @property
    def places(self) -> NDArray[np.float64]:
        """Places of people who stand, (n, 2) [m]."""
        return np.array([each[:2] for each in self._stopped]).reshape(-1, 2)

    def gaps(self, apart_m: float) -> NDArray[np.float64]:
        """Return the gaps between people up to a distance apart, as discs (k, 3) [m]: x, y, radius.

        A disc reaches from the middle of one person to that of another.
        """
        places = self.places
        first, second = np.triu_indices(len(places), 1)
        one, other = places[first], places[second]
        away_m = np.hypot(*(one - other).T)
        near = away_m <= apart_m
        discs: NDArray[np.float64] = np.column_stack([0.5 * (one + other), 0.5 * away_m])[near]
        return discs


def _is_near(place: tuple[float, float] | list[float], places: NDArray[np.float64]) -> bool:
    """Return whether a place is that of one of some people (n, 2) [m]."""
    return bool((np.hypot(*(places - place).T) < _SAME_M).any())
