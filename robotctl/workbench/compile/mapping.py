"""SLAM while driving, by each sensor, and the optimisation of graphs of every kind."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import config_directory
from robotctl.estimation.slam.beliefs.schedules import Residual, Synchronous
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import KINDS, POINT2, SE2, Floats, VariableKind
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother, SmootherConfig
from robotctl.estimation.slam.local_scans.registry import SCAN_SOURCES
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.solvers.belief_propagation import belief_propagation
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import CONSISTENT, SOLVERS
from robotctl.estimation.slam.start.registry import STARTS, start_values
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.workbench.slam.graphs import slam_of_graph

_POSES: Final = 6
_POINTS: Final = (100, 101, 102)
_LINKED: Final = ("between_2d", "between_3d")


def warm_up() -> None:
    """Map with each sensor; solve graphs in the plane and in space."""
    for sensor in SCAN_SOURCES:
        settings = (
            'localisation.method="slam"',
            f'localisation.sensors=["{sensor}"]',
            "camera.enabled=true",
        )
        options = StackOptions("compile", str(config_directory() / "diff_drive.toml"), settings)
        if (estimators := load_estimators(options.load(), options)) is not None:
            estimators.close()
    for pose in KINDS:
        if pose.is_pose:
            _solve(_graph(pose, [*FACTORS]))
            _solve(_graph(pose, ["between_2d", "between_3d", "seen_2d", "seen_3d"]))
    _solve_own_factor()
    _put_off()
    drive = _graph(SE2, ["between_2d", "range_bearing", "seen_2d"], is_drive=True)
    for most_features in (None, 3):
        slam_of_graph("drive", drive, lambda *_: None, most_features)


def _solve_own_factor() -> None:
    """Solve a graph with a factor of three variables, as users write their own."""
    halfway = FactorKind(
        "halfway", (POINT2,) * 3, 2, 2, lambda a, b, middle, z: middle - (a + b) / 2 - z
    )
    builder = GraphBuilder()
    builder.variables(POINT2, np.arange(3), np.eye(3, 2))
    builder.factors(halfway, np.array([[0, 1, 2]]), np.zeros((1, 2)), np.eye(2)[None])
    graph, values, _ = builder.build()
    SOLVERS["gn"](Problem(graph, values, np.array([0, 1]), most_iterations=2), nobody)


def _put_off() -> None:
    """Hang poses to a Bayes tree, and hold the loops, as where it is large."""
    smoother = IncrementalSmoother(SmootherConfig(renewal=0.0))
    kind = FACTORS["between_2d"]
    (z,), (information,) = _measured(kind, 1)
    for pose in range(_POSES):
        smoother.variable(SE2, pose * z, fixed=pose == 0)
        for other in (pose - 1, pose - 3):
            if other >= 0:
                smoother.factor(kind, (other, pose), (pose - other) * z, information)
        smoother.update()
        smoother.covariance(pose)


def _graph(pose: VariableKind, names: list[str], *, is_drive: bool = False) -> GraphFile:
    """Return poses in a row that all see the same points, by factors of some kinds."""
    builder = GraphBuilder()
    for name in names:
        kind = FACTORS[name]
        if kind.variables[0].positions == pose.positions:
            ids = _ids(kind)
            if name in _LINKED and not is_drive:
                ids += [(0, 3), (1, 4)]  # loops
            builder.factors(kind, np.array(ids), *_measured(kind, len(ids)))
    graph, values, known = builder.build()
    return GraphFile(graph, values, known, np.zeros(0, np.int64))


def _ids(kind: FactorKind) -> list[tuple[int, ...]]:
    """Return the variables that factors of a kind are between."""
    is_of_poses = [each.is_pose for each in kind.variables]
    if len(is_of_poses) == 1:
        return [(0,) if is_of_poses[0] else _POINTS[:1]]
    if all(is_of_poses):
        return [(k, k + 1) for k in range(_POSES - 1)]
    return list(product(range(_POSES), _POINTS))


def _measured(kind: FactorKind, count: int) -> tuple[Floats, Floats]:
    """Return measurements of some sense, and their information."""
    z = np.zeros((count, kind.measurement))
    z[:, 0] = 1.0
    if kind.measurement == 7:  # a quaternion ends it
        z[:, 6] = 1.0
    if kind.measurement == 9:  # a homography
        z[:] = np.eye(3).ravel()
    return z, np.tile(np.eye(kind.size), (count, 1, 1))


def _solve(file: GraphFile) -> None:
    """Optimise a graph by each solver from each start."""
    graph: FactorGraph = file.graph
    fixed = gauge(graph)
    starts = [start_values(graph, file.values, file.known, fixed, name) for name in STARTS]
    problem = Problem(graph, starts[-1], fixed, most_iterations=2)
    for solver in SOLVERS.values():
        solution = solver(problem, nobody)
        marginals(factored(graph, solution.values, fixed, solution.weights), [1, 2])
    SOLVERS["isam"](replace(problem, kernel=KERNELS[CONSISTENT]), nobody)
    for schedule in (Synchronous(), Residual()):
        belief_propagation(problem, nobody, schedule)
