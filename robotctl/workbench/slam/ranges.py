"""SLAM of logs of odometry and ranges to beacons."""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.factors.prior import PRIOR_2D, PRIOR_POINT_2D
from robotctl.estimation.slam.graph.factor import FactorBlock
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import POINT2, SE2
from robotctl.estimation.slam.range_only import RangeDrive, solve_ranges
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.logs.formats.plaza_log import RangeLog
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.model.geometry import se2
from robotctl.model.geometry.points import align, moved
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.result import Estimated, Landmarks, SlamResult

_KNOWN: Final = 0.05
"""Standard deviation of a surveyed beacon [m], or of the first pose [m, rad]."""


def slam_of_ranges(name: str, log: RangeLog) -> SlamResult:
    """Return drive and beacons of a log.

    They are in the frame of the surveyed beacons if two are known; else the drive begins where the
    true one does, or at the origin.

    Raises
    ------
    RobotctlError
        If no beacon has enough ranges.
    """
    stamps = log.stamps_s
    # The first line counts from a stamp before it, a usual step away.
    stamps = np.concatenate([[stamps[0] - np.median(np.diff(stamps))], stamps])
    after = np.clip(np.searchsorted(stamps, log.range_stamps_s), 1, len(stamps) - 1)
    is_before = log.range_stamps_s - stamps[after - 1] < stamps[after] - log.range_stamps_s
    rows = (after - is_before).astype(np.int64)
    ids, beacons = np.unique(log.beacons, return_inverse=True)
    began_ns = time.process_time_ns()
    try:
        drive = solve_ranges(log.steps, rows, beacons, log.ranges_m)
    except ValueError as error:
        raise RobotctlError(f"{name}: {error}") from error
    names = [int(ids[row]) for row in drive.graph.ids[POINT2]]
    stamps_ns = np.round(1e9 * stamps).astype(np.int64)
    file = _held(drive, log, names, int(stamps_ns[0]))
    spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
    poses, points = file.values[SE2], file.values[POINT2]
    is_used = drive.weights >= OFF
    counts = [int(np.count_nonzero(is_used & (log.beacons == each))) for each in names]
    return SlamResult(
        name,
        Estimated(Trajectory(stamps_ns, poses)),
        None,
        Landmarks(tuple(names), points, np.zeros((len(points), 2, 2)), tuple(counts)),
        file,
        log.reference,
        log.surveyed,
        figures={
            "association": "names",
            "sightings": {"used": sum(counts), "unused": len(is_used) - sum(counts)},
            "range_sigma_m": drive.sigma_m,
            "turn_bias_rad": drive.turn_bias_rad,
            "time_ms": {"ranges": spent_ms},
        },
    )


def _held(drive: RangeDrive, log: RangeLog, names: list[int], begin_ns: int) -> GraphFile:
    """Return the graph where surveyed beacons, or its first pose, hold it with a prior."""
    graph, values = drive.graph, drive.values
    count = len(graph.ids[SE2])
    ids = {SE2: graph.ids[SE2], POINT2: np.array(names, np.int64) + count}
    known = [row for row, each in enumerate(names) if each in log.surveyed]
    if len(known) > 1:
        places = np.array([log.surveyed[names[row]] for row in known])
        values = _moved(values, align(values[POINT2][known], places))
        information = np.tile(np.eye(2) / _KNOWN**2, (len(known), 1, 1))
        prior = FactorBlock(PRIOR_POINT_2D, (np.array(known),), places, information)
    else:
        begin = log.reference.at(begin_ns) if log.reference is not None else None
        values = _moved(values, begin or se2.SE2())
        prior = FactorBlock(
            PRIOR_2D, (np.zeros(1, np.int64),), values[SE2][:1], np.eye(3)[None] / _KNOWN**2
        )
    found = {kind: np.ones(len(each), np.bool_) for kind, each in ids.items()}
    whole = FactorGraph(ids, (*graph.blocks, prior))
    return GraphFile(whole, values, found, np.empty(0, np.int64))


def _moved(values: Values, motion: se2.SE2) -> Values:
    """Return values in a frame in which the present one stands at a pose."""
    poses = values[SE2]
    return {
        SE2: np.column_stack([moved(motion, poses[:, :2]), poses[:, 2] + motion.theta_rad]),
        POINT2: moved(motion, values[POINT2]),
    }
