"""EKF-SLAM along a factor graph of poses in a row and of points that they see."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.ekf_slam.features import POINT, SEEN_POINT, FeatureKind
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.estimation.slam.ekf_slam.joined_maps import JoinedMaps
from robotctl.estimation.slam.ekf_slam.way import way_of
from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.factors.landmarks import RANGE_BEARING, SEEN_2D
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, is_definite
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, blocks_of
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]

MEASURED: Final[dict[FactorKind, FeatureKind]] = {SEEN_2D: SEEN_POINT, RANGE_BEARING: POINT}
"""Factors of sightings, and the kinds of features that they are of."""


class GraphDrive:
    """SLAM along the poses of a graph, in the order of their ids, with known association.

    Parameters
    ----------
    graph
        Poses in the plane, each linked with the next one, and points.
    start
        First pose: x [m], y [m], theta [rad] in the world, (3,).
    past_poses
        About how many poses are kept, evenly along the way.
    most_features
        Of a local map, kept poses counting as two; None: one map for all.

    Raises
    ------
    ValueError
        If poses are not linked in a row, there are factors of other kinds, or information is
        singular.
    """

    def __init__(
        self, graph: FactorGraph, start: Array, past_poses: int, most_features: int | None = None
    ) -> None:
        for block in graph.blocks:
            if block.kind is not BETWEEN_2D and block.kind not in MEASURED:
                raise ValueError(f"factors {block.kind.name!r} are not for the filter")
            good = is_definite(block.information)
            if not np.all(good):
                ends = [int(each[np.argmin(good)]) for each in graph.numbers(block)]
                raise ValueError(f"information between {graph.names(ends)} is singular")
        count = len(graph.ids.get(POSES, ()))
        self.deltas = np.full((count, 3), math.nan)
        """Pose of each in the frame of the one before, (n, 3); the first is nan."""
        self._noises = np.zeros((count, 3, 3))
        for block in blocks_of(graph, BETWEEN_2D):
            first, second = block.variables
            wrong = np.flatnonzero(second != first + 1)
            if len(wrong):
                a, b = (graph.ids[POSES][rows[wrong[0]]] for rows in (first, second))
                raise ValueError(f"poses {a} and {b} are linked, which do not follow each other")
            self.deltas[second] = block.measurements
            self._noises[second] = np.linalg.inv(block.information)
        missing = np.flatnonzero(np.isnan(self.deltas[1:, 0]))
        if len(missing) or count < 2:
            at = graph.ids[POSES][missing[0] + 1] if len(missing) else "the first"
            raise ValueError(f"nothing leads to pose {at} from the one before it")
        self._seen: dict[int, list[tuple[FeatureKind, int, Array, Array]]] = {}
        for block in graph.blocks:
            kind = MEASURED.get(block.kind)
            if kind is not None:
                self._sort(kind, block)
        steps_m = np.hypot(*np.nan_to_num(self.deltas[:, :2]).T)
        marks = np.floor(np.cumsum(steps_m) / max(steps_m.sum(), 1e-9) * past_poses)
        kept = np.flatnonzero(np.diff(marks) > 0) + 1
        self._kept = [0, *kept[kept < count - 1].tolist(), count - 1]
        self._maps = None if most_features is None else JoinedMaps(most_features)
        if self._maps is not None:  # a local map begins at its own origin
            self._maps.belief.x[:], start = start, np.zeros(3)
        self._slam = EkfSlam(start.copy(), 1e-12 * np.eye(3))
        self.online = np.zeros((count, 3))
        """Poses as they were estimated at their time, (n, 3)."""

    def steps(self) -> Iterator[int]:
        """Go along the poses; yield how many are done."""
        kept, maps = set(self._kept), self._maps
        for row in range(len(self.deltas)):
            if row:
                self._move(self.deltas[row], self._noises[row])
            if row in kept:
                self._slam.remember(row)
            self._see(row)
            pose = self._slam.pose if maps is None else maps.base @ self._slam.pose
            self.online[row] = pose.x_m, pose.y_m, pose.theta_rad
            is_last = row == len(self.deltas) - 1
            if maps is not None and (is_last or maps.is_full(self._slam)):
                self._slam = maps.join(self._slam)
            yield row + 1

    def point(self, row: int) -> tuple[Array, Array]:
        """Return where a landmark is, by its row (2,), and the covariance of that (2, 2)."""
        if self._maps is not None:
            return self._maps.feature(row)
        number = self._slam.names.index(row)
        return self._slam.features[number], self._slam.covariance(number)

    def _past(self, row: int) -> tuple[SE2, Array]:
        """Return a pose that was kept, and its covariance (3, 3)."""
        return (self._maps or self._slam).past(row)

    def poses(self) -> Array:
        """Return all poses with all that was seen, (n, 3)."""
        known = [self._past(row)[0] for row in self._kept]
        return way_of(self.deltas, self._kept, known)

    def past(self) -> tuple[NDArray[np.int64], Array]:
        """Return the rows of the poses that were kept, (k,), and their covariances (k, 3, 3)."""
        return np.array(self._kept), np.array([self._past(row)[1] for row in self._kept])

    def _sort(self, kind: FeatureKind, block: FactorBlock) -> None:
        """Put sightings to the poses that they are from."""
        poses, points = block.variables
        noises = np.linalg.inv(block.information)
        for row, point, z, R in zip(
            poses.tolist(), points.tolist(), block.measurements, noises, strict=True
        ):
            self._seen.setdefault(row, []).append((kind, point, z, R))

    def _move(self, delta: Array, noise: Array) -> None:
        """Move by what odometry says; its noise is in the frame of the pose behind the motion."""
        pose = self._slam.pose
        end = pose @ SE2(*delta.tolist())
        F = np.eye(3)
        F[0, 2], F[1, 2] = pose.y_m - end.y_m, end.x_m - pose.x_m
        c, s = math.cos(end.theta_rad), math.sin(end.theta_rad)
        G = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        x_v = np.array([end.x_m, end.y_m, end.theta_rad])
        self._slam.predict(x_v, F, G @ noise @ G.T)

    def _see(self, row: int) -> None:
        """Take what a pose sees, kind by kind."""
        seen = self._seen.get(row, [])
        for kind in MEASURED.values():
            mine = [each[1:] for each in seen if each[0] is kind]
            if mine:
                names = [point for point, _, _ in mine]
                z, R = (np.array([each[column] for each in mine]) for column in (1, 2))
                self._slam.sight(kind, names, z, R)
