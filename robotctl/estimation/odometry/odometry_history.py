"""Recent poses of the odometry: measurements are older than the newest state."""

from __future__ import annotations

from collections import deque
from typing import Final

from robotctl.model.drives.motion import between
from robotctl.model.geometry.se2 import SE2

_KEPT: Final = 100
"""Poses: two seconds at the rate of the control states."""


class OdometryHistory:
    """The last poses of `base` in the frame of the odometry, in the order of their times."""

    def __init__(self) -> None:
        self._poses: deque[tuple[int, SE2]] = deque(maxlen=_KEPT)
        self._epoch_ns = 0

    def add(self, stamp_ns: int, pose: SE2, epoch_ns: int = 0) -> None:
        """Add a pose; one that is not newer than the last is left out.

        With another `epoch_ns`, that of `odom`, all earlier poses are forgotten.
        """
        if epoch_ns != self._epoch_ns:
            self._poses.clear()
            self._epoch_ns = epoch_ns
        if not self._poses or stamp_ns > self._poses[-1][0]:
            self._poses.append((stamp_ns, pose))

    @property
    def newest_ns(self) -> int | None:
        """Time of the last pose [ns]; None before the first."""
        return self._poses[-1][0] if self._poses else None

    def at(self, stamp_ns: int) -> SE2 | None:
        """Return the pose at a time, interpolated; the last pose if the time is newer than all.

        None if it is older than all.
        """
        poses = self._poses
        if not poses or stamp_ns < poses[0][0]:
            return None
        after_ns, after = poses[-1]
        if stamp_ns >= after_ns:
            return after
        for before_ns, before in reversed(poses):
            if before_ns <= stamp_ns:
                share = (stamp_ns - before_ns) / (after_ns - before_ns)
                return between(before, after, share)
            after_ns, after = before_ns, before
        return None
