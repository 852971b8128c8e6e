"""SLAM of files of factor graphs, and the smoother of all graphs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.ekf_slam.graph_drive import GraphDrive
from robotctl.estimation.slam.ekf_slam.recorded import PAST_POSES
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import POINT2, SE2
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.solvers.batch import levenberg_marquardt
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.result import Estimated, Landmarks, SlamResult

Array: TypeAlias = NDArray[np.float64]

_SECOND_NS = 1_000_000_000
_TOLD = 200


def slam_of_graph(
    name: str,
    file: GraphFile,
    progress: Callable[[int, int], None],
    most_features: int | None = None,
) -> SlamResult:
    """Filter along a graph of poses in a row and landmarks; its poses get their row as time [s].

    The drive begins at the first pose if that is fixed, else at the origin. With `most_features` in
    local maps, that are joined.

    Raises
    ------
    ValueError
        If the graph is none, or another variable than the first pose is fixed.
    """
    others = file.fixed[file.fixed != 0].tolist()
    if others:
        raise ValueError(f"{file.graph.names(others)} fixed: for the filter only the first pose is")
    start = file.values[SE2][0] if len(file.fixed) and SE2 in file.values else np.zeros(3)
    drive = GraphDrive(file.graph, start, PAST_POSES, most_features)
    count = len(drive.deltas)
    began_ns = time.process_time_ns()
    for done in drive.steps():
        if done % _TOLD == 0:
            progress(done, count)
    spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
    ids = file.graph.ids.get(POINT2, np.empty(0, np.int64))
    marks = [drive.point(row) for row in range(len(ids))]
    seen = np.zeros(len(ids), np.int64)
    for block in file.graph.blocks:
        if block.kind.variables[-1] is POINT2:
            np.add.at(seen, block.variables[-1], 1)
    rows, covariances = drive.past()
    stamps_ns = np.arange(count) * _SECOND_NS
    poses = drive.poses()
    points = np.array([place for place, _ in marks]).reshape(-1, 2)
    values: Values = {SE2: poses, POINT2: points} if len(ids) else {SE2: poses}
    return SlamResult(
        name,
        Estimated(Trajectory(stamps_ns, poses), rows, covariances),
        Estimated(Trajectory(stamps_ns, drive.online)),
        Landmarks(
            tuple(ids.tolist()),
            points,
            np.array([covariance for _, covariance in marks]).reshape(-1, 2, 2),
            tuple(seen.tolist()),
        ),
        _separated(file, values),
        figures={
            "association": "names",
            "sightings": {"used": int(seen.sum()), "unused": 0},
            "time_ms": {"filter": spent_ms},
        },
    )


def smoothed(result: SlamResult) -> SlamResult:
    """Return a result at the optimum of its graph, by Levenberg and Marquardt.

    Raises
    ------
    GraphError
        If the factors do not determine all variables.
    """
    graph, file = result.graph.graph, result.graph
    fixed = gauge(graph, file.fixed)
    began_ns = time.process_time_ns()
    solution = levenberg_marquardt(Problem(graph, file.values, fixed), nobody)
    spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
    equations = factored(graph, solution.values, fixed, solution.weights)
    poses = solution.values[SE2]
    rows = np.unique(np.linspace(0, len(poses) - 1, PAST_POSES).astype(np.int64))
    own = np.array(marginals(equations, [graph.first(SE2) + int(row) for row in rows]))
    turned = np.zeros_like(own)
    turned[:, 2, 2] = 1.0
    c, s = np.cos(poses[rows, 2]), np.sin(poses[rows, 2])
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1] = c, -s, s, c
    points = solution.values.get(POINT2, np.empty((0, 2)))
    numbers = [graph.first(POINT2) + row for row in range(len(points))]
    return replace(
        result,
        estimate=Estimated(
            Trajectory(result.estimate.trajectory.stamps_ns, poses),
            rows,
            turned @ own @ turned.transpose(0, 2, 1),
        ),
        landmarks=replace(
            result.landmarks,
            positions=points,
            covariances=np.array(marginals(equations, numbers)).reshape(-1, 2, 2),
        ),
        graph=replace(file, values=solution.values),
        figures={
            **result.figures,
            "chi2": solution.chi2[-1],
            "iterations": len(solution.chi2) - 1,
            "time_ms": {**result.figures["time_ms"], "graph": spent_ms},
        },
    )


def _separated(file: GraphFile, values: Values) -> GraphFile:
    """Return a graph whose points have ids behind those of the poses, as g2o wants them."""
    ids = dict(file.graph.ids)
    if POINT2 in ids:
        ids[POINT2] = ids[POINT2] + int(ids[SE2].max()) + 1
    known = {kind: np.ones(len(each), np.bool_) for kind, each in ids.items()}
    return GraphFile(FactorGraph(ids, file.graph.blocks), values, known, file.fixed)
