"""A map of keyframes while it is edited: keyframes and links come and go, and poses follow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.visual.features import Features
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.estimation.slam.keyframes.back_end import BackEnd, KeyframeLink, KeyframeLinks, as_row
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.keyframe import Keyframe
from robotctl.estimation.slam.keyframes.linking import Linking
from robotctl.estimation.slam.keyframes.loops import LoopSearch
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap
from robotctl.estimation.slam.solvers.batch import levenberg_marquardt
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.model.geometry.points import rotation
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.slam.keyframe_graph import graph_of

Progress: TypeAlias = Callable[[int, int], None]

_MOST_PASSES: Final = 4
"""Number of times that all keyframes are looked at for new links, at most."""
_AT_ONCE: Final = 25
"""Number of keyframes that are linked again between two updates of the graph."""


class EditedMap:
    """Keyframes of one or more drives, in `world`.

    Parameters
    ----------
    maps
        The map that is edited, and those that may be joined to it.
    config
        Settings of their sensor.

    Attributes
    ----------
    keyframes, images, back_end
        As in `SlamMapper`.
    drives
        Number of the drive of each keyframe, (n,): a cut begins another.
    origins
        Map and number from which each keyframe is, (n, 2).
    before
        Poses before the first edit, each in the `world` of its map, (n, 3).
    place
        The robot's keyframe in the first map, and `base` in it.
    """

    epoch = 0
    """As in `SlamMapper`: all keyframes are new to a file."""

    def __init__(self, maps: Sequence[KeyframeMap], config: KeyframeConfig) -> None:
        self._config = config
        self.keyframes: list[Keyframe] = []
        self.images: dict[int, Features] = {}
        rows: list[Floats] = []
        links: list[KeyframeLink] = []
        weights: list[float] = []
        for each in maps:
            begin = len(self.keyframes)
            way_m = max((other.travelled_m for other in self.keyframes), default=0.0)
            self.keyframes += [
                replace(other, travelled_m=way_m + other.travelled_m) for other in each.keyframes
            ]
            self.images |= {begin + number: image for number, image in each.images.items()}
            rows += [as_row(each.frame @ SE2(*row)) for row in each.poses.tolist()]
            links += [
                replace(link, first=begin + link.first, second=begin + link.second)
                for link in each.links
            ]
            weights += each.weights
        counts = [len(each.keyframes) for each in maps]
        self.drives = np.repeat(np.arange(len(maps)), counts)
        self.origins = np.column_stack(
            [self.drives, np.concatenate([np.arange(n) for n in counts])]
        )
        self.place = maps[0].place
        self.before = np.array(rows)
        self._set(self.before, links, weights)

    def _set(self, poses: Floats, links: list[KeyframeLink], weights: list[float]) -> None:
        """Take poses and links as they are."""
        self.back_end = BackEnd(self._config.shared**2)
        self.back_end.poses, self.back_end.weights = poses, weights
        self.back_end.links = KeyframeLinks(links)

    @property
    def growing(self) -> GrowingMap:
        """The map as the stages of SLAM take it."""
        return GrowingMap(self._config, self.keyframes, self.back_end)

    def _filtered(self, is_kept: Sequence[bool]) -> None:
        """Leave links out."""
        back_end = self.back_end
        pairs = zip(back_end.links, back_end.weights, is_kept, strict=True)
        kept = [(link, weight) for link, weight, stays in pairs if stays]
        self._set(back_end.poses, [link for link, _ in kept], [weight for _, weight in kept])

    def drop(self, dropped: set[int]) -> None:
        """Leave keyframes out and renumber the others; their links hold those beside them."""
        if not dropped:
            return
        back_end, count = self.back_end, len(self.keyframes)
        kept = [each for each in range(count) if each not in dropped]
        bridges = [
            self._bridge(first, second)
            for first, second in pairwise(kept)
            if second > first + 1 and self.drives[first] == self.drives[second]
        ]
        number, pose = self.place
        if number in dropped:
            nearest = min(kept, key=lambda each: abs(each - number))
            pose, number = back_end.between(nearest, number) @ pose, nearest
        new = {old: row for row, old in enumerate(kept)}
        links = [
            (replace(link, first=new[link.first], second=new[link.second]), weight)
            for link, weight in [
                *zip(back_end.links, back_end.weights, strict=True),
                *((each, 1.0) for each in bridges if each is not None),
            ]
            if link.first in new and link.second in new
        ]
        self.place = new[number], pose
        self.keyframes = [self.keyframes[each] for each in kept]
        self.images = {new[each]: image for each, image in self.images.items() if each in new}
        self.drives, self.origins = self.drives[kept], self.origins[kept]
        self.before = self.before[kept]
        self._set(back_end.poses[kept], [link for link, _ in links], [w for _, w in links])

    def _bridge(self, first: int, second: int) -> KeyframeLink | None:
        """Return what the links from keyframe to keyframe say of two; None if there is a gap."""
        pose: SE2 = SE2()
        covariance: Floats = np.zeros((3, 3))
        for before in range(first, second):
            steps = [
                each
                for each in self.back_end.links
                if (each.first, each.second) == (before, before + 1) and not each.is_loop
            ]
            if not steps:
                return None
            known = sum((each.information for each in steps), np.zeros((3, 3)))
            base = steps[0].pose
            off = sum(
                (each.information @ np.array((base.inverse() @ each.pose).log()) for each in steps),
                np.zeros(3),
            )
            step = base @ SE2.exp(*np.linalg.solve(known, off).tolist())
            back, A = step.inverse(), np.eye(3)  # the error so far, as seen from there
            A[:2, :2] = rotation(back.theta_rad).T
            A[:2, 2] = back.y_m, -back.x_m
            covariance = A @ covariance @ A.T + np.linalg.inv(known)
            pose = pose @ step
        return KeyframeLink(first, second, pose, np.linalg.inv(covariance).astype(np.float64))

    def refuse(self, first: int, second: int, reach: int) -> list[tuple[int, int]]:
        """Leave out a loop: its links, and those beside these, and so on.

        Returns
        -------
        list
            Keyframes that they linked.
        """
        links = self.back_end.links
        rows = [row for row, each in enumerate(links) if each.is_loop]
        ends = np.array([sorted((links[row].first, links[row].second)) for row in rows])
        found: set[int] = set()
        edge = [np.array(sorted((first, second)))]
        while edge and rows:
            at = edge.pop()
            new = set(np.flatnonzero(np.abs(ends - at).max(axis=1) <= reach).tolist()) - found
            found |= new
            edge += [ends[each] for each in new]
        out = {rows[each] for each in found}
        self._filtered([row not in out for row in range(len(links))])
        return [(int(ends[each][0]), int(ends[each][1])) for each in found]

    def loop_nearest(self, first: int, second: int) -> tuple[int, int] | None:
        """Return the keyframes of the loop whose numbers are nearest; None: there is no loop."""
        ends = [sorted((each.first, each.second)) for each in self.back_end.links if each.is_loop]
        if not ends:
            return None
        off = np.abs(np.array(ends) - sorted((first, second))).max(axis=1)
        a, b = ends[int(np.argmin(off))]
        return a, b

    def cut(self, before: int) -> int:
        """Leave out the links along the way from before a keyframe; return how many."""
        window = self._config.local_keyframes
        is_kept = [
            link.is_loop
            or not min(link.first, link.second) < before <= max(link.first, link.second)
            or abs(link.first - link.second) > window
            for link in self.back_end.links
        ]
        self._filtered(is_kept)
        after = (np.arange(len(self.drives)) >= before) & (self.drives == self.drives[before])
        self.drives[after] = self.drives.max() + 1
        return is_kept.count(False)

    def parts(self) -> NDArray[np.int64]:
        """Return the part of the map to which each keyframe is linked, (n,)."""
        parts: NDArray[np.int64] = graph_of(self.back_end).graph.components()
        return parts

    def place_at(self, pose: SE2) -> None:
        """Move the whole map, so that its first keyframe has a pose."""
        motion = pose @ self.back_end.pose(0).inverse()
        self.back_end.poses = _carried(self.back_end.poses, motion)

    def add(self, links: Sequence[KeyframeLink], first: int, second: int, pose: SE2) -> None:
        """Add links that give one keyframe's pose in another, and move the map accordingly.

        A part that was on its own is carried there first.
        """
        poses, parts = self.back_end.poses, self.parts()
        if parts[first] != parts[second]:
            at, to = second, self.back_end.pose(first) @ pose
            if parts[second] == parts[0]:
                at, to = first, self.back_end.pose(second) @ pose.inverse()
            is_part = parts == parts[at]
            motion = to @ self.back_end.pose(at).inverse()
            poses = poses.copy()
            poses[is_part] = _carried(poses[is_part], motion)
        weights = [*self.back_end.weights, *[1.0] * len(links)]
        self._set(poses, [*self.back_end.links, *links], weights)
        self.solve()

    def solve(self) -> None:
        """Move all keyframes to the optimum of the graph."""
        file = graph_of(self.back_end)
        if not file.graph.blocks:
            return
        fixed = gauge(file.graph)
        solution = levenberg_marquardt(Problem(file.graph, file.values, fixed), nobody)
        self.back_end.poses = solution.values[POSES]

    def load(self) -> None:
        """Give the graph to the smoother, which takes links one by one."""
        poses, links, weights = self.back_end.poses, self.back_end.links, self.back_end.weights
        self.back_end = BackEnd(self._config.shared**2)
        self.back_end.load(poses, links, weights)

    def link_again(self, refused: Sequence[tuple[int, int]], reach: int, progress: Progress) -> int:
        """Link keyframes that lie beside each other now, as while mapping; return how many links.

        Visits that are linked already get no more, with those within `reach` of a keyframe as one
        visit; those that were refused stay apart.
        """
        back_end, before = self.back_end, len(self.back_end.links)
        linking = Linking(self.growing, LoopSearch(self.growing))
        count, seen = len(self.keyframes), 0
        apart: dict[int, set[int]] = {each: self._passed(each) for each in range(count)}
        for pair in refused:
            for a, b in (pair, pair[::-1]):
                for each in _around(a, reach, count):
                    apart[each].update(_around(b, reach, count))
        for _ in range(_MOST_PASSES):
            had = len(back_end.links)
            for number in range(count):
                for link in back_end.links[seen:]:
                    first, second = sorted((link.first, link.second))
                    apart[second].update(_around(first, reach, count))
                seen = len(back_end.links)
                linking.link_again(number, sorted(apart[number]))
                if number % _AT_ONCE == 0:
                    back_end.update()
                progress(number + 1, count)
            back_end.update()
            back_end.reweigh()
            if len(back_end.links) == had:
                break
        return len(back_end.links) - before

    def _passed(self, number: int) -> set[int]:
        """Return the keyframes passed just before one, on the same drive."""
        beside = range(max(number - self._config.linked_keyframes, 0), number)
        return {each for each in beside if self.drives[each] == self.drives[number]}


def _around(number: int, reach: int, count: int) -> range:
    """Return the numbers within reach of one, of so many."""
    return range(max(number - reach, 0), min(number + reach + 1, count))


def _carried(poses: Floats, motion: SE2) -> Floats:
    """Return poses (n, 3) moved by a motion."""
    return np.array([as_row(motion @ SE2(*row)) for row in poses.tolist()])
