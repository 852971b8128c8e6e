"""The frames of a ROS bag over time, from its tf messages."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field

from robotctl.model.geometry.se3 import SE3


@dataclass(slots=True)
class _Edge:
    """Where a frame is in its parent: for ever, or over time."""

    parent: str
    fixed: SE3 | None = None
    moving: list[tuple[int, SE3]] = field(default_factory=list)
    in_order: bool = True

    def at(self, stamp_ns: int) -> SE3:
        """Return it at a time, interpolated; before the first and after the last, these."""
        if not self.in_order:
            self.moving.sort(key=lambda entry: entry[0])
            self.in_order = True
        if self.fixed is not None or not self.moving:
            return self.fixed or SE3()
        after = bisect_left(self.moving, stamp_ns, key=lambda entry: entry[0])
        if after == 0:
            return self.moving[0][1]
        if after == len(self.moving):
            return self.moving[-1][1]
        (begin_ns, begin), (end_ns, end) = self.moving[after - 1], self.moving[after]
        return _between(begin, end, (stamp_ns - begin_ns) / (end_ns - begin_ns))


def _between(begin: SE3, end: SE3, share: float) -> SE3:
    """Return a pose between two that are near each other."""
    turn = 1.0 if sum(map(float.__mul__, begin.quaternion, end.quaternion)) >= 0.0 else -1.0

    def mixed(a: Sequence[float], b: Sequence[float], sign: float) -> list[float]:
        return [(1.0 - share) * one + share * sign * other for one, other in zip(a, b, strict=True)]

    x, y, z = mixed(begin.translation_m, end.translation_m, 1.0)
    qw, qx, qy, qz = mixed(begin.quaternion, end.quaternion, turn)
    return SE3((x, y, z), (qw, qx, qy, qz))


class Frames:
    """A tree of frames, each known in its parent."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = {}

    def add(self, parent: str, child: str, stamp_ns: int, pose: SE3, *, is_static: bool) -> None:
        """Add a message; a child with a new parent moves there."""
        edge = self._edges.get(child)
        if edge is None or edge.parent != parent:
            edge = self._edges[child] = _Edge(parent)
        if is_static:
            edge.fixed = pose
        else:
            edge.in_order = edge.in_order and not (edge.moving and edge.moving[-1][0] > stamp_ns)
            edge.moving.append((stamp_ns, pose))

    def chain(self, frame: str) -> list[str]:
        """Return a frame, its parent, the parent of that and so on, to the root."""
        frames = [frame]
        while (edge := self._edges.get(frames[-1])) and edge.parent not in frames:
            frames.append(edge.parent)
        return frames

    def moves(self, frame: str) -> bool:
        """Return whether a frame was ever elsewhere in its parent."""
        edge = self._edges.get(frame)
        return edge is not None and edge.fixed is None and len({p for _, p in edge.moving}) > 1

    def stamps_ns(self, frame: str) -> list[int]:
        """Return the times at which a moving frame is known in its parent."""
        edge = self._edges.get(frame)
        return [] if edge is None else sorted(stamp_ns for stamp_ns, _ in edge.moving)

    def lookup(self, target: str, source: str, stamp_ns: int) -> SE3 | None:
        """Return `T_target_source` at a time; None if the two do not hang together."""
        to_root, from_source = self.chain(target), self.chain(source)
        common = next((frame for frame in from_source if frame in to_root), None)
        if common is None:
            return None
        up = self._in_ancestor(from_source, common, stamp_ns)
        return self._in_ancestor(to_root, common, stamp_ns).inverse() @ up

    def _in_ancestor(self, chain: Sequence[str], ancestor: str, stamp_ns: int) -> SE3:
        """Return the first frame of a chain in one of its ancestors."""
        pose = SE3()
        for frame in chain[: chain.index(ancestor)]:
            pose = self._edges[frame].at(stamp_ns) @ pose
        return pose
