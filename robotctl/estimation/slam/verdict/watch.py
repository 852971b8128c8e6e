"""The verdict on a map while it is made."""

from __future__ import annotations

from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.verdict.map_check import shift_of
from robotctl.estimation.slam.verdict.odometry_check import OdometryCheck
from robotctl.estimation.slam.verdict.verdict import (
    Quality,
    RunFigures,
    Verdict,
    verdict_of,
)
from robotctl.model.geometry.se2 import SE2


class VerdictWatch:
    """Follows a mapper that has odometry: a scan at a time, one keyframe checked with each new one.

    Parameters
    ----------
    mapper
        Makes the map.

    Attributes
    ----------
    said
        The verdict as a sentence.
    """

    def __init__(self, mapper: SlamMapper) -> None:
        self._mapper = mapper
        self._odometry = OdometryCheck()
        self._shifts_m: dict[int, float | None] = {}
        self._scans = self._turn = 0
        self._seen = mapper.epoch, len(mapper.keyframes)
        self._verdict = Verdict(Quality.GOOD)
        self.said = str(self._verdict)

    def add(self, odometry: SE2) -> list[str]:
        """Take note of the scan that the mapper took last, and of `base` in `odom` then.

        Returns
        -------
        list of str
            What people should hear: the verdict where it has changed.
        """
        mapper = self._mapper
        epoch, keyframes = self._seen
        self._scans += 1
        if mapper.epoch != epoch or mapper.is_lost:
            self._odometry.restart(odometry, mapper.pose)
        self._odometry.add(odometry, mapper.pose)
        self._seen = mapper.epoch, len(mapper.keyframes)
        if len(mapper.keyframes) == keyframes:
            return []
        # The newest and, in turn with it, those of before again: the map may have changed since.
        count, self._turn = len(mapper.keyframes), self._turn + 1
        number = count - 1 if self._turn % 2 else (self._turn // 2) % count
        self._shifts_m[number] = shift_of(mapper.growing, number)
        before, self._verdict = self._verdict, self._now()
        self.said = str(self._verdict)
        return (
            [] if self._verdict.quality is before.quality else [f"verdict on the map: {self.said}"]
        )

    def _now(self) -> Verdict:
        """Return the verdict on what is known."""
        return verdict_of(
            RunFigures(
                self._scans,
                self._mapper.tracker.unmatched,
                self._mapper.tracker.ambiguous,
                [each for each in self._shifts_m.values() if each is not None],
                self._odometry.figures(),
            ),
            self._mapper.config.tuning.verdict,
        )
