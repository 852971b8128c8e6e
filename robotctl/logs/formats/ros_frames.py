"""The frames of a ROS bag over time, from its tf messages."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from robotctl.logs.formats.timeline import Series
from robotctl.model.geometry.se3 import SE3

_GAP_NS, _PERIODS = 1_000_000_000, 10
"""Minimum silence on a moving frame during which it is unknown [ns], and in usual periods."""
_STOOD_M: Final = 0.1
"""Maximum motion over a silence during which a frame counts as known [m]."""
_TRAVELS_M: Final = 1.0
"""Maximum motion of the parts of one robot against each other [m]."""


class Edge(NamedTuple):
    """A frame in its parent, by tf; a source of a log."""

    child: str
    parent: str
    is_static: bool

    def __str__(self) -> str:
        return f"tf of {self.child} in {self.parent}"


@dataclass(frozen=True, slots=True)
class _Motion:
    """Poses of a frame in its parent over time."""

    parent: str
    series: Series
    stamps_ns: list[int]
    poses: list[SE3]
    moves: bool
    reach_m: float
    """Extent of its positions along the longest axis [m]."""
    gap_ns: float

    def at(self, stamp_ns: int) -> SE3 | None:
        """Return the pose at a time, interpolated; None if unknown."""
        if not self.moves:
            return self.poses[0]
        after = bisect_left(self.stamps_ns, stamp_ns)
        if after == len(self.poses):
            return None
        end_ns, end = self.stamps_ns[after], self.poses[after]
        if end_ns == stamp_ns:
            return end
        if after == 0:
            return None
        begin_ns, begin = self.stamps_ns[after - 1], self.poses[after - 1]
        if end_ns - begin_ns > self.gap_ns and _distance_m(begin, end) > _STOOD_M:
            return None
        return _between(begin, end, (stamp_ns - begin_ns) / (end_ns - begin_ns))


def _motion(edge: Edge, series: Series) -> _Motion:
    """Return the motion of an edge."""
    poses: list[SE3] = series.values
    moves = not edge.is_static and len(set(poses)) > 1
    places = np.array([pose.translation_m for pose in poses])
    gap_ns = float(_GAP_NS)
    if moves:
        gap_ns = max(gap_ns, _PERIODS * float(np.median(np.diff(series.stamps_ns))))
    return _Motion(
        edge.parent,
        series,
        series.stamps_ns.tolist(),
        poses[-1:] if edge.is_static else poses,
        moves,
        float(np.max(np.ptp(places, axis=0))) if moves else 0.0,
        gap_ns,
    )


def _distance_m(one: SE3, other: SE3) -> float:
    return float(np.linalg.norm(np.subtract(one.translation_m, other.translation_m)))


def _between(begin: SE3, end: SE3, share: float) -> SE3:
    """Return a pose between two that are near each other."""
    turn = 1.0 if sum(map(float.__mul__, begin.quaternion, end.quaternion)) >= 0.0 else -1.0

    def mixed(a: Sequence[float], b: Sequence[float], sign: float) -> list[float]:
        return [(1.0 - share) * one + share * sign * other for one, other in zip(a, b, strict=True)]

    x, y, z = mixed(begin.translation_m, end.translation_m, 1.0)
    qw, qx, qy, qz = mixed(begin.quaternion, end.quaternion, turn)
    return SE3((x, y, z), (qw, qx, qy, qz))


class Frames:
    """A tree of frames, each known in its parent.

    Parameters
    ----------
    edges
        Edges of tf. For a frame with several parents the most frequent one counts.
    notes
        Sentences for people, extended here.
    """

    def __init__(self, edges: Mapping[Edge, Series], notes: list[str]) -> None:
        by_child: dict[str, list[Edge]] = defaultdict(list)
        for edge, series in edges.items():
            if len(series):
                by_child[edge.child].append(edge)
        self._motions: dict[str, _Motion] = {}
        for child, found in by_child.items():
            best = max(found, key=lambda edge: (len(edges[edge]), edge.is_static))
            self._motions[child] = _motion(best, edges[best])
            others = sorted({edge.parent for edge in found} - {best.parent})
            if others:
                notes.append(
                    f"tf has {child} in {best.parent} and in {', '.join(others)}: {best.parent} is "
                    "taken, which it tells most often"
                )

    def names(self) -> set[str]:
        """Return the names of all frames."""
        return {*self._motions, *(motion.parent for motion in self._motions.values())}

    def chain(self, frame: str) -> list[str]:
        """Return a frame, its parent, the parent of that and so on, to the root."""
        frames = [frame]
        while (motion := self._motions.get(frames[-1])) and motion.parent not in frames:
            frames.append(motion.parent)
        return frames

    def moves(self, frame: str) -> bool:
        """Return whether a frame ever moved in its parent."""
        motion = self._motions.get(frame)
        return motion is not None and motion.moves

    def travels(self, frame: str) -> bool:
        """Return whether a frame moves farther in its parent than a part of a robot does."""
        motion = self._motions.get(frame)
        return motion is not None and motion.reach_m > _TRAVELS_M

    def series(self, frame: str) -> Series:
        """Return the tf entries of a frame that has a parent."""
        return self._motions[frame].series

    def common(self, frame: str, other: str) -> str | None:
        """Return the lowest common ancestor of two frames; None if they are not connected."""
        to = self.chain(other)
        return next((each for each in self.chain(frame) if each in to), None)

    def are_one(self, frame: str, other: str) -> bool:
        """Return whether two frames are connected, without a travelling frame in between."""
        common = self.common(frame, other)
        if common is None:
            return False
        chains = self.chain(frame), self.chain(other)
        between = (each for chain in chains for each in chain[: chain.index(common)])
        return not any(map(self.travels, between))

    def lookup(self, target: str, source: str, stamp_ns: int) -> SE3 | None:
        """Return `T_target_source` at a time.

        None if the two are not connected, or tf does not cover the time.
        """
        common = self.common(target, source)
        if common is None:
            return None
        up = self._in_ancestor(self.chain(source), common, stamp_ns)
        down = self._in_ancestor(self.chain(target), common, stamp_ns)
        return None if up is None or down is None else down.inverse() @ up

    def _in_ancestor(self, chain: Sequence[str], ancestor: str, stamp_ns: int) -> SE3 | None:
        """Return the first frame of a chain in one of its ancestors."""
        pose = SE3()
        for frame in chain[: chain.index(ancestor)]:
            step = self._motions[frame].at(stamp_ns)
            if step is None:
                return None
            pose = step @ pose
        return pose
