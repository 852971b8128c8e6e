"""The pose graph of the keyframes, smoothed as it grows."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.compiled import compiled
from robotctl.estimation.slam.factors.between import BETWEEN_2D, residual_2d
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.robust.robust_cost import OFF, scale
from robotctl.model.geometry.se2 import SE2

DRIFT_M: Final = 0.02
DRIFT_RAD: Final = 0.01
"""Drift of matched scans per metre that their covariances do not contain [m, rad]."""

LOOSE_M: Final = 0.25
LOOSE_RAD: Final = 0.08
"""With less doubt between, old keyframes are where they are; others are loops to close."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeLink:
    """A measured pose of keyframe `second` in `first`, with its information (3, 3)."""

    first: int
    second: int
    pose: SE2
    information: Floats
    is_loop: bool = False


def as_row(pose: SE2) -> Floats:
    """Return x, y, theta as an array."""
    return np.array([pose.x_m, pose.y_m, pose.theta_rad])


def certain(doubts: Floats) -> NDArray[np.bool_]:
    """Return of which keyframes the place is certain, by `BackEnd.doubts`, (n,)."""
    result: NDArray[np.bool_] = (doubts[:, 0] < LOOSE_M) & (doubts[:, 1] < LOOSE_RAD)
    return result


class BackEnd:
    """Poses of keyframes in `map`; the first is at its origin.

    Parameters
    ----------
    repeats
        So many links of loops say the same, since scans share echoes: each counts less.
    """

    def __init__(self, repeats: float = 1.0) -> None:
        self._repeats = repeats
        self._smoother = IncrementalSmoother()
        self.links: list[KeyframeLink] = []
        self.weights: list[float] = []
        self.poses = np.empty((0, 3))
        self._length: list[float] = []
        self._heads = np.full(64, -1, np.int64)
        self._following = np.full(1024, -1, np.int64)
        self._ends = np.zeros(1024, np.int64)
        self._variances = np.zeros((1024, 2))

    def add(self, pose: SE2) -> int:
        """Add a keyframe at a pose; return its number."""
        number = self._smoother.variable(POSES, as_row(pose), fixed=len(self.poses) == 0)
        self.poses = np.vstack([self.poses, as_row(pose)])
        if number >= len(self._heads):
            self._heads = np.append(self._heads, np.full(number, -1, np.int64))
        return number

    def link(self, link: KeyframeLink) -> None:
        """Add a link."""
        self._smoother.factor(
            BETWEEN_2D, (link.first, link.second), as_row(link.pose), self.counted(link)
        )
        at = 2 * len(self.links)
        if at + 2 > len(self._following):
            self._following = np.append(self._following, np.full(at, -1, np.int64))
            self._ends = np.append(self._ends, np.zeros(at, np.int64))
            self._variances = np.append(self._variances, np.zeros((at, 2)), axis=0)
        covariance = np.linalg.inv(link.information + 1e-3 * np.eye(3))
        length = np.hypot(link.pose.x_m, link.pose.y_m)
        doubt = (
            covariance[0, 0] + covariance[1, 1] + DRIFT_M**2 * length,
            covariance[2, 2] + DRIFT_RAD**2 * length,
        )
        for slot, (own, other) in enumerate(((link.first, link.second), (link.second, link.first))):
            self._following[at + slot] = self._heads[own]
            self._heads[own] = at + slot
            self._ends[at + slot] = other
            self._variances[at + slot] = doubt
        self.links.append(link)
        self.weights.append(1.0)

    def counted(self, link: KeyframeLink) -> Floats:
        """Return the information (3, 3) with which a link counts, beside others that repeat it."""
        return link.information / self._repeats if link.is_loop else link.information

    def load(self, poses: Floats, links: list[KeyframeLink], weights: list[float]) -> None:
        """Take a whole graph, near its optimum; nothing has been added before."""
        for row in poses.tolist():
            self.add(SE2(*row))
        for number, (link, weight) in enumerate(zip(links, weights, strict=True)):
            self.link(link)
            if weight != 1.0:
                self.weigh(number, weight)
        self.refine()

    def update(self) -> None:
        """Take in what was added."""
        self._smoother.update()
        self.poses = self._smoother.estimates(POSES)

    def refine(self) -> None:
        """Relinearise until the estimate is that of a batch."""
        self._smoother.refine()
        self.poses = self._smoother.estimates(POSES)

    def close(self, links: list[KeyframeLink]) -> None:
        """Add the links of a loop, optimise, and take weight from contradicted links."""
        for link in links:
            self.link(link)
        self.update()
        self.reweigh()

    def finish(self) -> None:
        """Make the estimate exact, after the last link."""
        self.refine()
        self.reweigh()
        self.refine()

    def pose(self, number: int) -> SE2:
        """Return the pose of a keyframe in `map`."""
        return SE2(*self.poses[number].tolist())

    def between(self, first: int, second: int) -> SE2:
        """Return the pose of one keyframe in another."""
        return self.pose(first).inverse() @ self.pose(second)

    def squares(self, numbers: list[int]) -> Floats:
        """Return r^T Omega r of some links."""
        links = [self.links[each] for each in numbers]
        r = residual_2d(
            self.poses[[each.first for each in links]],
            self.poses[[each.second for each in links]],
            np.array([as_row(each.pose) for each in links]),
        )
        omega = np.array([each.information for each in links])
        result: Floats = np.einsum("ni,nij,nj->n", r, omega, r)
        return result

    def weigh(self, number: int, weight: float) -> None:
        """Change the weight of a link from the next update on."""
        self._smoother.weigh(number, weight)
        self.weights[number] = weight

    def reweigh(self) -> None:
        """Take weight from links of loops that the graph contradicts."""
        numbers = [number for number, link in enumerate(self.links) if link.is_loop]
        if not numbers:
            return
        weights = KERNELS["dcs"].weight(self.squares(numbers), scale(3))
        for number, weight in zip(numbers, weights.tolist(), strict=True):
            if abs(weight - self.weights[number]) > OFF:
                self.weigh(number, weight)
        self.update()

    def doubts(self, number: int) -> Floats:
        """Return standard deviations of position [m] and heading [rad] of all others, (n, 2).

        Along the links with the least doubt, which is more than there is.
        """
        variances = _least_doubt(
            number, len(self.poses), self._heads, self._following, self._ends, self._variances,
            self.poses,
        )  # fmt: skip
        result: Floats = np.sqrt(variances)
        return result


@compiled
def _least_doubt(
    start: int, count: int, heads: NDArray[np.int64], following: NDArray[np.int64],
    ends: NDArray[np.int64], variances: Floats, poses: Floats,
) -> Floats:  # fmt: skip
    """Return variances of position and heading along the best paths (Dijkstra), (count, 2)."""
    result = np.full((count, 2), np.inf)
    result[start] = 0.0
    is_done = np.zeros(count, np.bool_)
    queue = [(0.0, start)]
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        if is_done[node]:
            continue
        is_done[node] = True
        entry = heads[node]
        while entry >= 0:
            other = ends[entry]
            dx = poses[other, 0] - poses[node, 0]
            dy = poses[other, 1] - poses[node, 1]
            position = result[node, 0] + variances[entry, 0] + result[node, 1] * (dx * dx + dy * dy)
            if position < result[other, 0]:
                result[other, 0] = position
                result[other, 1] = result[node, 1] + variances[entry, 1]
                heapq.heappush(queue, (position, other))
            entry = following[entry]
    return result
