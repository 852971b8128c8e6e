"""The pose graph of the keyframes, smoothed as it grows."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.grown import Grown
from robotctl.estimation.slam.factors.between import BETWEEN_2D, residual_2d
from robotctl.estimation.slam.front_end.point_to_line import SIGMA_M
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.robust.robust_cost import OFF, scale
from robotctl.model.geometry.se2 import SE2

DRIFT_M: Final = 0.02
DRIFT_RAD: Final = 0.01
"""Drift of matched scans per metre that their covariances do not contain [m, rad]."""
_NEARLY_NOTHING: Final = 1e-3 * np.eye(3)
"""Information that makes a matrix of a match along a corridor invertible."""
UNSEEN_M: Final = 0.008
"""Systematic error of echoes [m], which leaves no residuals: all ranges too long, or too short."""
LOOSE_M: Final = 0.25
LOOSE_RAD: Final = 0.08
"""With less doubt between, old keyframes are where they are; others are loops to close."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeLink:
    """A measured pose of keyframe `second` in `first`, with its information (3, 3).

    A link of a loop loses its weight where the graph contradicts it, unless a person gave it.
    """

    first: int
    second: int
    pose: SE2
    information: Floats
    is_loop: bool = False
    is_given: bool = False


class KeyframeLinks(Sequence[KeyframeLink]):
    """Links by number, in a quarter of the memory of a list of them.

    Parameters
    ----------
    links
        The first ones.
    """

    def __init__(self, links: Iterable[KeyframeLink] = ()) -> None:
        self._ends, self._poses = Grown((2,), np.int32), Grown((3,), float)
        self._information, self._kinds = Grown((3, 3), float), Grown((2,), np.bool_)
        for link in links:
            self.append(link)

    def append(self, link: KeyframeLink) -> None:
        """Add a link."""
        self._ends.add(((link.first, link.second),))
        self._poses.add((as_row(link.pose),))
        self._information.add((link.information,))
        self._kinds.add(((link.is_loop, link.is_given),))

    def __len__(self) -> int:
        return self._ends.size

    @overload
    def __getitem__(self, number: int) -> KeyframeLink: ...
    @overload
    def __getitem__(self, number: slice) -> list[KeyframeLink]: ...
    def __getitem__(self, number: int | slice) -> KeyframeLink | list[KeyframeLink]:
        if isinstance(number, slice):
            return [self[each] for each in range(*number.indices(len(self)))]
        first, second = self.ends[number].tolist()
        is_loop, is_given = self._kinds.view[number].tolist()
        pose, information = SE2(*self.poses[number].tolist()), self.information[number].copy()
        return KeyframeLink(first, second, pose, information, is_loop, is_given)

    @property
    def ends(self) -> NDArray[np.int32]:
        """Keyframes `first` and `second`, (n, 2)."""
        return self._ends.view

    @property
    def poses(self) -> Floats:
        """Rows of measured poses, (n, 3) [m, m, rad]."""
        return self._poses.view

    @property
    def information(self) -> Floats:
        """Information of each, (n, 3, 3)."""
        return self._information.view

    @property
    def is_loop(self) -> NDArray[np.bool_]:
        """Whether each is of a loop, (n,)."""
        return self._kinds.view[:, 0]

    @property
    def is_given(self) -> NDArray[np.bool_]:
        """Whether a person gave each, (n,)."""
        return self._kinds.view[:, 1]


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
        self.links = KeyframeLinks()
        self.weights: list[float] = []
        self.poses = np.empty((0, 3))
        self._marginal: tuple[int, Floats] | None = None
        self._matches = self._sharpness = 1.0
        self._heads = np.full(64, -1, np.int64)
        self._following = np.full(1024, -1, np.int64)
        self._ends = np.zeros(1024, np.int64)
        self._variances = np.zeros((1024, 2))

    def observe(self, rms_m: float) -> None:
        """Learn from the residuals [m] of two scans that match how far echoes are off a wall."""
        self._matches += 1.0
        self._sharpness += SIGMA_M**2 / (rms_m**2 + UNSEEN_M**2)

    @property
    def variance_factor(self) -> float:
        """Ratio of the variance of echoes that residuals show to the one that matches assume.

        The a posteriori variance of unit weight, by which an adjustment's covariances count. Links
        add their information, so the mean is harmonic; the assumption is one match among them.
        """
        return self._matches / self._sharpness

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
        length = math.hypot(link.pose.x_m, link.pose.y_m)
        covariance = np.linalg.inv(link.information + _NEARLY_NOTHING)
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

    def counted_of(self, numbers: NDArray[np.int64]) -> Floats:
        """Return the information with which some links count, (n, 3, 3)."""
        repeats = np.where(self.links.is_loop[numbers], self._repeats, 1.0)
        result: Floats = self.links.information[numbers] / repeats[:, None, None]
        return result

    def load(self, poses: Floats, links: Iterable[KeyframeLink], weights: list[float]) -> None:
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
        self._marginal = None

    def refine(self) -> None:
        """Relinearise until the estimate is that of a batch."""
        self._smoother.refine()
        self.poses = self._smoother.estimates(POSES)
        self._marginal = None

    def close(self, links: list[KeyframeLink]) -> None:
        """Add the links of a loop, optimise, and take weight from contradicted links."""
        for link in links:
            self.link(link)
        self.update()
        self.reweigh()

    def finish(self) -> None:
        """Make the estimate exact, after the last link; links that hardly count no longer do."""
        self.refine()
        self.reweigh()
        for number, weight in enumerate(self.weights):
            if weight < OFF:
                self.weigh(number, 0.0)
        self.refine()

    def pose(self, number: int) -> SE2:
        """Return the pose of a keyframe in `map`."""
        return SE2(*self.poses[number].tolist())

    def between(self, first: int, second: int) -> SE2:
        """Return the pose of one keyframe in another."""
        return self.pose(first).inverse() @ self.pose(second)

    def marginal(self, number: int) -> Floats:
        """Return the covariance (3, 3) of a keyframe's pose in `map`, in its own frame.

        By the graph as it was updated last, with the variances that its links assume; nothing is
        uncertain of the first keyframe.
        """
        if self._marginal is None or self._marginal[0] != number:
            self._marginal = number, self._smoother.covariance(number)
        return self._marginal[1]

    def squares(self, numbers: NDArray[np.int64]) -> Floats:
        """Return r^T Omega r of some links, (n,)."""
        links = self.links
        first, second = links.ends[numbers].T
        r = residual_2d(self.poses[first], self.poses[second], links.poses[numbers])
        result: Floats = np.einsum("ni,nij,nj->n", r, links.information[numbers], r)
        return result

    def weigh(self, number: int, weight: float) -> None:
        """Change the weight of a link from the next update on."""
        self._smoother.weigh(number, weight)
        self.weights[number] = weight

    def reweigh(self) -> None:
        """Take weight from links of loops that the graph contradicts."""
        numbers = np.flatnonzero(self.links.is_loop & ~self.links.is_given)
        if len(numbers) == 0:
            return
        weights = KERNELS["dcs"].weight(self.squares(numbers), scale(3))
        for number, weight in zip(numbers.tolist(), weights.tolist(), strict=True):
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
