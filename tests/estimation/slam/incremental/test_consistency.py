"""Loops that the graph contradicts are off as soon as it does, and what was off in error is on."""

import itertools

import numpy as np
import pytest

from benchmarks.graphs import city, false_loops
from robotctl.estimation.slam.factors.between import BETWEEN_2D, BETWEEN_3D
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import SE2, SE3
from robotctl.estimation.slam.incremental.consistency import ConsistentClosures
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import CONSISTENT, SOLVERS
from robotctl.estimation.slam.start.registry import start_values
from robotctl.logs.graphs.graph_format import GraphFile

pytestmark = pytest.mark.timeout(600)  # the first of them compiles


def solved(file, solver, kernel=None):
    fixed = gauge(file.graph, file.fixed)
    start = start_values(file.graph, file.values, file.known, fixed, "odometry")
    return SOLVERS[solver](Problem(file.graph, start, fixed, KERNELS.get(kernel)), nobody)


@pytest.mark.parametrize("noise", [1.0, 50.0])
def test_a_third_of_false_loops_is_off_and_right_ones_are_on(noise):
    clean = city(1200, 1400)
    told = [each.take(np.arange(len(each))) for each in clean.graph.blocks]
    for block in told:
        block.information[:] /= noise  # as of public graphs, which claim too much noise
    clean = GraphFile(FactorGraph(clean.graph.ids, tuple(told)), *(getattr(clean, n) for n in ("values", "known", "fixed")))  # fmt: skip # noqa: E501
    wrong = false_loops(clean, 0.5, 0)
    solution = solved(wrong, "isam", CONSISTENT)
    (weights,) = solution.weights
    assert not weights[clean.graph.factors :].any()
    assert weights[: clean.graph.factors].mean() > 0.99
    off = (solution.values[SE2] - solved(clean, "lm").values[SE2])[:, :2]
    assert np.sqrt(np.mean(off**2)) < 0.02


def line(kind, pose_of, count):
    """Return a smoother with poses in a row, one metre apart."""
    smoother = IncrementalSmoother()
    ends = [smoother.variable(kind, pose_of(k), fixed=k == 0) for k in range(count)]
    information = np.diag([100.0] * (kind.dof // 2 + kind.dof % 2) + [1e4] * (kind.dof // 2))
    factor = BETWEEN_2D if kind is SE2 else BETWEEN_3D
    for a, b in itertools.pairwise(ends):
        smoother.factor(factor, (a, b), pose_of(1), information)
    smoother.update()
    return smoother, factor, information


def in_plane(x):
    return np.array([float(x), 0.0, 0.0])


def in_space(x):
    return np.array([float(x), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize(("kind", "pose_of"), [(SE2, in_plane), (SE3, in_space)])
def test_two_false_loops_that_agree_hold_until_three_contradict_them(kind, pose_of):
    smoother, factor, information = line(kind, pose_of, 60)
    closures = ConsistentClosures(smoother)

    def close(a, b, measured):
        found = closures.add(factor, (a, b), pose_of(measured), information)
        smoother.update()
        closures.settle()
        return found

    def is_on(closure):
        table, row = closure
        return bool(table.is_on[row])

    false = [close(k, 50 + k, 46.5) for k in range(2)]  # 3.5 m short
    assert all(map(is_on, false))
    true = [close(k, 50 + k, 50.0) for k in range(3, 8)]
    closures.finish()
    assert all(map(is_on, true))
    assert not any(map(is_on, false))
    assert smoother.estimate(59) == pytest.approx(pose_of(59), abs=1e-3)


def test_a_forecast_has_the_covariance_of_the_whole_system():
    file = city(400, 420)
    graph, fixed = file.graph, gauge(file.graph, file.fixed)
    solution = solved(file, "lm")
    smoother = IncrementalSmoother()
    for k, value in enumerate(solution.values[SE2]):
        smoother.variable(SE2, value, fixed=k in fixed)
    (block,) = graph.blocks
    for i, j, z, information in zip(*block.variables, block.measurements, block.information, strict=True):  # fmt: skip # noqa: E501
        smoother.factor(BETWEEN_2D, (int(i), int(j)), z, information)
    smoother.update()
    _, P = smoother.forecast(BETWEEN_2D, (0, 300), np.zeros(3))
    exact = marginals(factored(graph, solution.values, fixed, [np.ones(len(block))]), [300])[0]
    theta = solution.values[SE2][300, 2]
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]]
    assert pytest.approx(turn @ exact @ turn.T, rel=1e-6, abs=1e-9) == P
