"""The factor graph of a recorded drive, with the calibration and the association of the filter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.estimation.slam.ekf_slam.recorded import RecordedSlam
from robotctl.estimation.slam.ekf_slam.way import way_of
from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.factors.landmarks import SEEN_2D
from robotctl.estimation.slam.factors.prior import PRIOR_2D
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import inverses
from robotctl.estimation.slam.graph.variables import POINT2, SE2
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.model.geometry.points import rotation
from robotctl.model.geometry.pose_estimate import PoseEstimate

_LEAST = 1e-10 * np.eye(3)
"""Minimum covariance of the motion: that of a robot that stands."""


def graph_of_recording(
    drive: RecordedSlam, start: PoseEstimate, names: tuple[int | str, ...]
) -> tuple[GraphFile, list[int]]:
    """Return the graph of a drive at what the filter found, and the times of its poses [ns].

    Poses are at the times of sightings, and those that the filter kept; they have the ids from 0
    on, landmarks those behind them in the order of `names`.
    """
    stamps_ns = sorted({*drive.past_ns, *(stamp_ns for stamp_ns, _, _ in drive.seen)})
    rows = {stamp_ns: row for row, stamp_ns in enumerate(stamps_ns)}
    count = len(stamps_ns)
    deltas, noises = np.zeros((count, 3)), np.zeros((count, 3, 3))
    for row, (begin_ns, end_ns) in enumerate(pairwise(stamps_ns), 1):
        made = drive.motion(begin_ns, end_ns)
        deltas[row] = made.x[:3]
        noises[row] = _in_own_frame(made.Q[:3, :3] + _LEAST, made.x[2])
    build = GraphBuilder()
    kept = [rows[stamp_ns] for stamp_ns in drive.past_ns]
    known = [drive.run.slam.past(stamp_ns)[0] for stamp_ns in drive.past_ns]
    ids = np.arange(count)
    build.variables(SE2, ids, way_of(deltas, kept, known))
    features = drive.run.slam.features
    numbers = [drive.run.slam.names.index(name) for name in names]
    build.variables(POINT2, count + np.arange(len(names)), features[numbers])
    first = np.array([[start.pose.x_m, start.pose.y_m, start.pose.theta_rad]])
    doubt = _in_own_frame(start.covariance, start.pose.theta_rad)
    build.factors(PRIOR_2D, ids[:1, np.newaxis], first, inverses(doubt[np.newaxis]))
    steps = np.stack([ids[:-1], ids[1:]], axis=1)
    build.factors(BETWEEN_2D, steps, deltas[1:], inverses(noises[1:]))
    places = {name: count + number for number, name in enumerate(names)}
    seen = [each for each in drive.seen if each[1] in places]
    x = drive.run.slam.x_v.copy()
    x[:3] = 0.0
    z = np.array([[each.range_m, each.bearing_rad] for _, _, each in seen])
    points = np.array([CAMERA_POINT.initial(x, row) for row in z])
    _, _, by_point = CAMERA_POINT.expected(x, points)
    R = inverses(drive.run.noise(z))
    build.factors(
        SEEN_2D,
        np.array([[rows[stamp_ns], places[name]] for stamp_ns, name, _ in seen]),
        points,
        by_point.transpose(0, 2, 1) @ R @ by_point,
    )
    graph, values, found = build.build()
    return GraphFile(graph, values, found, np.empty(0, np.int64)), stamps_ns


def _in_own_frame(covariance: NDArray[np.float64], theta_rad: float) -> NDArray[np.float64]:
    """Return a covariance (3, 3) of a pose with axes as those of a pose at this heading."""
    G = np.eye(3)
    G[:2, :2] = rotation(theta_rad)
    return G @ covariance @ G.T
