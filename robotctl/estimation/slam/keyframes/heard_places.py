"""Loops by sonars: a robot that turns once on the spot hears whether it did so there before."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.signature_turn import Turn, TurnCollector
from robotctl.estimation.slam.keyframes.loops import Hint, LoopSearch
from robotctl.estimation.slam.keyframes.mapper import Place
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount, SonarReading

_SHIFT_M: Final = 1.0
_TURN_RAD: Final = 0.5
"""How far from where it sounds alike the robot may be."""
_KEPT: Final = 8
"""Turns that wait until the mapper knows where they ended."""


class _Stand(NamedTuple):
    """A pose of `base` in a keyframe."""

    keyframe: int
    pose: SE2


class HeardPlaces:
    """Compares each turn on the spot with those before, and tells a search of loops.

    Attributes
    ----------
    turns, recognised
        How many were heard, and how many of them at a place known by then.

    Parameters
    ----------
    mounts
        Of the sonars.
    loops
        Where to look for loops; scans bear out what the sonars say.
    """

    def __init__(self, mounts: Sequence[SonarMount], loops: LoopSearch) -> None:
        self.turns = self.recognised = 0
        self._loops = loops
        self._book = PlaceBook()
        self._collector = TurnCollector(mounts, self._book.signatures)
        self._stands: dict[str, _Stand] = {}
        self._waiting: deque[Turn] = deque(maxlen=_KEPT)

    def begin_odometry(self) -> None:
        """Take the odometry of the next reading for another one."""
        self._collector.reset()
        self._waiting.clear()

    def hear(self, reading: SonarReading, odometry: SE2) -> None:
        """Take a reading, and `base` in `odom` at its time."""
        turn = self._collector.add(reading, odometry)
        if turn is not None:
            self._waiting.append(turn)

    def look(self, place: Place, odometry: SE2) -> None:
        """Look at turns that ended before a scan, with its place and `base` in `odom` then."""
        while self._waiting and self._waiting[0].stamp_ns <= place.stamp_ns:
            turn = self._waiting.popleft()
            at_end = place.pose @ odometry.inverse() @ turn.odometry
            self._look(turn, _Stand(place.keyframe, at_end))

    def _look(self, turn: Turn, now: _Stand) -> None:
        """Recognise the place of a turn; learn it, if it is new."""
        self.turns += 1
        if self._book.too_little(turn.signature):
            return
        found = self._book.recognise(turn.signature).place
        if found is None:
            name = str(self.turns)
            self._book = self._book.learned(name, turn.signature)
            self._stands[name] = now
            return
        self.recognised += 1
        old = self._stands[found.place]
        at = old.pose @ found.pose @ now.pose.inverse()
        self._loops.suggest(Hint(now.keyframe, old.keyframe, "sonar turn", at, _SHIFT_M, _TURN_RAD))
