"""The factor graph of a recorded drive, with the calibration and the association of the filter."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from robotctl.estimation.slam.ekf_slam.camera_points import CAMERA_POINT
from robotctl.estimation.slam.ekf_slam.recorded import RecordedSlam
from robotctl.estimation.slam.ekf_slam.way import way_of
from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.factors.landmarks import SEEN_2D
from robotctl.estimation.slam.factors.prior import PRIOR_2D
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import POINT2, SE2
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.logs.graphs.gtsam_text import inverses
from robotctl.model.geometry.pose_estimate import PoseEstimate


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
        c, s = np.cos(made.x[2]), np.sin(made.x[2])
        G = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # into the frame of the end
        noises[row] = G @ (made.Q[:3, :3] + _LEAST) @ G.T
    build = GraphBuilder()
    kept = [rows[stamp_ns] for stamp_ns in drive.past_ns]
    known = [drive.run.slam.past(stamp_ns)[0] for stamp_ns in drive.past_ns]
    ids = np.arange(count)
    build.variables(SE2, ids, way_of(deltas, kept, known))
    features = drive.run.slam.belief.features
    numbers = [drive.run.slam.names.index(name) for name in names]
    build.variables(POINT2, count + np.arange(len(names)), features[numbers])
    first = np.array([[start.pose.x_m, start.pose.y_m, start.pose.theta_rad]])
    c, s = np.cos(first[0, 2]), np.sin(first[0, 2])
    G = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    build.factors(
        PRIOR_2D, ids[:1, np.newaxis], first, np.linalg.inv(G @ start.covariance @ G.T)[np.newaxis]
    )
    build.factors(
        BETWEEN_2D, np.stack([ids[:-1], ids[1:]], axis=1), deltas[1:], inverses(noises[1:])
    )
    places = {name: count + number for number, name in enumerate(names)}
    seen = [each for each in drive.seen if each[1] in places]
    x = drive.run.slam.belief.x_v.copy()
    x[:3] = 0.0
    z = np.array([[each.range_m, each.bearing_rad] for _, _, each in seen])
    points = np.array([CAMERA_POINT.initial(x, row) for row in z])
    _, _, by_point = CAMERA_POINT.expected(x, points)
    R = np.linalg.inv(drive.run.noise(z))
    build.factors(
        SEEN_2D,
        np.array([[rows[stamp_ns], places[name]] for stamp_ns, name, _ in seen]),
        points,
        by_point.transpose(0, 2, 1) @ R @ by_point,
    )
    graph, values, found = build.build()
    return GraphFile(graph, values, found, np.empty(0, np.int64)), stamps_ns


_LEAST = 1e-10 * np.eye(3)
"""Of a robot that stands."""
