"""Result of SLAM on a drive, and its quality."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.kalman.consistency import share_inside
from robotctl.estimation.slam.ekf_slam.filter import tangent_nees
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.model.geometry.points import align, moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """The landmarks of a map.

    Parameters
    ----------
    names
        As the log or the association has them, k.
    positions, covariances
        In `world`, (k, 2) [m] and (k, 2, 2) [m^2].
    sightings
        How often each was seen, (k,).
    """

    names: tuple[int | str, ...]
    positions: Array
    covariances: Array
    sightings: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Estimated:
    """Poses that were estimated, some with their covariances.

    Parameters
    ----------
    trajectory
        The poses.
    rows, covariances
        Which of them have one, (k,), and these, (k, 3, 3) of (x, y, theta) in `world`.
    """

    trajectory: Trajectory
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    covariances: Array = field(default_factory=lambda: np.empty((0, 3, 3)))

    def compared(self, reference: Trajectory | None) -> dict[str, Any] | None:
        """Return how far the poses are from those of a reference; None without any.

        `rmse_m` is after the turn and shift that fit the trajectory best to the reference, as the
        world of SLAM is where it starts; `unaligned_rmse_m` is before. NEES is before, too.
        """
        if reference is None:
            return None
        pairs = [
            (row, truth)
            for row, stamp_ns in enumerate(self.trajectory.stamps_ns.tolist())
            if (truth := reference.at(stamp_ns)) is not None
        ]
        if len(pairs) < 2:
            return None
        rows = [row for row, _ in pairs]
        own = self.trajectory.poses[rows]
        true = np.array([[pose.x_m, pose.y_m] for _, pose in pairs])
        off = np.hypot(*(moved(align(own[:, :2], true), own[:, :2]) - true).T)
        result: dict[str, Any] = {
            "poses": len(rows),
            "rmse_m": math.sqrt(float(np.mean(off**2))),
            "max_m": float(off.max()),
            "unaligned_rmse_m": math.sqrt(float(np.mean(np.sum((own[:, :2] - true) ** 2, axis=1)))),
        }
        doubts = dict(zip(self.rows.tolist(), self.covariances, strict=True))
        nees = np.array(
            [
                tangent_nees(SE2(*self.trajectory.poses[row].tolist()), doubts[row], truth)
                for row, truth in pairs
                if row in doubts
            ]
        )
        if len(nees):
            result["nees_mean"] = float(nees.mean())
            result["nees_inside_95"] = share_inside(nees, 3)
        return result


@dataclass(slots=True, eq=False)
class SlamResult:
    """A drive after SLAM.

    Parameters
    ----------
    name
        Of the log.
    estimate
        The drive with all that was seen.
    online
        The drive as the filter had it at each time, with what was seen until then; None without.
    landmarks
        The map.
    graph
        The drive as a factor graph, at the estimate.
    reference, true_landmarks
        What the log knows of the truth.
    figures
        Of the method: counts and times.
    notes
        For people.
    """

    name: str
    estimate: Estimated
    online: Estimated | None
    landmarks: Landmarks
    graph: GraphFile
    reference: Trajectory | None = None
    true_landmarks: dict[int, tuple[float, float]] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def report(self) -> dict[str, Any]:
        """Return the figures; the keys stand in docs/slam.md."""
        return {
            "log": self.name,
            "notes": list(self.notes),
            "landmarks": len(self.landmarks.names),
            **self.figures,
            "trajectory": self.estimate.compared(self.reference),
            "online": None if self.online is None else self.online.compared(self.reference),
            "landmark_rmse_m": self._landmark_rmse(),
        }

    def _landmark_rmse(self) -> float | None:
        """Return how far landmarks with known names are from the truth after alignment [m]."""
        rows = [row for row, name in enumerate(self.landmarks.names) if name in self.true_landmarks]
        if len(rows) < 3 or len(rows) < len(self.landmarks.names):
            return None
        true = np.array([self.true_landmarks[int(self.landmarks.names[row])] for row in rows])
        points = self.landmarks.positions[rows]
        off = moved(align(points, true), points) - true
        return math.sqrt(float(np.mean(np.sum(off**2, axis=1))))
