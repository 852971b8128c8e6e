"""Loops by sonars: a robot that turns once on the spot hears whether it did so there before."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.signature_turn import Turn, TurnCollector
from robotctl.estimation.slam.keyframes.loops import Candidate, LoopSearch
from robotctl.estimation.slam.keyframes.motion import Place
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount, SonarReading

_SHIFT_M: Final = 1.0
_TURN_RAD: Final = 0.5
"""How far from where it sounds alike the robot may be."""
_KEPT: Final = 8
"""Turns that wait until the mapper knows where they ended."""


class HeardPlaces:
    """Compares each turn on the spot with those before, and tells a search of loops.

    Parameters
    ----------
    mounts
        Of the sonars.
    loops
        Where to look for loops; scans bear out what the sonars say.
    """

    def __init__(self, mounts: Sequence[SonarMount], loops: LoopSearch) -> None:
        self._loops = loops
        self._book = PlaceBook()
        self._collector = TurnCollector(mounts, self._book.signatures)
        self._places: dict[str, Place] = {}
        """Places where the turns of the book ended."""
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
            self._look(turn, Place(turn.stamp_ns, place.keyframe, at_end))

    def _look(self, turn: Turn, now: Place) -> None:
        """Recognise the place of a turn; learn it, if it is new."""
        if self._book.too_little(turn.signature):
            return
        found = self._book.recognise(turn.signature).place
        if found is None:
            name = f"turn {len(self._places) + 1}"
            self._book = self._book.learned(name, turn.signature)
            self._places[name] = now
            return
        old = self._places[found.place]
        at = old.pose @ found.pose @ now.pose.inverse()
        self._loops.suggest(
            Candidate(now.keyframe, old.keyframe, "sonar turn", _SHIFT_M, _TURN_RAD, at)
        )
