"""Loops by sonars: a robot that turns once on the spot hears whether it did so there before."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.recogniser import Candidate, Recognition
from robotctl.estimation.places.signature_turn import Turn, TurnCollector
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.motion import ScanPose
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount, SonarReading

_KEPT: Final = 8
"""Number of turns that wait until the mapper knows where they ended; few end between two scans."""


class PlacedTurn(NamedTuple):
    """A turn on the spot, and where the robot was at its end."""

    turn: Turn
    place: ScanPose


class HeardPlaces:
    """Compares each turn on the spot with those before, and suggests loops.

    Parameters
    ----------
    mounts
        Mounting of the sonars.
    loops
        Verifies the suggestions by scans.
    """

    def __init__(self, mounts: Sequence[SonarMount], loops: LoopSearch) -> None:
        self._loops = loops
        self._book = PlaceBook()
        self._collector = TurnCollector(mounts, self._book.signatures)
        self._places: dict[str, ScanPose] = {}
        """Places where the turns of the book ended."""
        self._waiting: deque[Turn] = deque(maxlen=_KEPT)

    def begin_odometry(self) -> None:
        """Start with another odometry at the next reading."""
        self._collector.reset()
        self._waiting.clear()

    def hear(self, reading: SonarReading, odometry: SE2) -> None:
        """Take a reading, and `base` in `odom` at its time."""
        turn = self._collector.add(reading, odometry)
        if turn is not None:
            self._waiting.append(turn)

    def look(self, place: ScanPose, odometry: SE2) -> None:
        """Compare turns that ended before a scan, with its place and `base` in `odom` then."""
        while self._waiting and self._waiting[0].stamp_ns <= place.stamp_ns:
            turn = self._waiting.popleft()
            at_end = place.pose @ odometry.inverse() @ turn.odometry
            ended = PlacedTurn(turn, ScanPose(turn.stamp_ns, place.keyframe, at_end))
            self._loops.suggest(place.keyframe, "sonar turn", self.suggest(ended).candidates)

    def suggest(self, sensed: PlacedTurn) -> Recognition[Candidate[int]]:
        """Return the keyframe in which a turn like this one ended; remember one of a new place."""
        signature, now = sensed.turn.signature, sensed.place
        problem = self._book.too_little(signature)
        if problem:
            return Recognition((), problem)
        recognition = self._book.suggest(signature)
        found = recognition.found
        if found is None:
            name = f"turn {len(self._places) + 1}"
            self._book = self._book.learned(name, signature)
            self._places[name] = now
            return Recognition((), recognition.refusal)
        old = self._places[found.place]
        pose = old.pose @ found.pose @ now.pose.inverse()
        return Recognition((Candidate(old.keyframe, pose, found.score),))
