"""Factors and variables of one's own, against scipy on the same cost and dense matrices."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import FactorKind
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, values_of
from robotctl.estimation.slam.graph.variables import POINT2, SE2, VariableKind
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother, SmootherConfig
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.robust.robust_cost import scale
from robotctl.estimation.slam.solvers.problem import Problem, nobody
from robotctl.estimation.slam.solvers.registry import SOLVERS

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
SCALE = VariableKind("scale", 1, 1, 0, (1.0,), lambda values, steps: values + steps)
RANGE, BETWEEN = FACTORS["range"], FACTORS["between_2d"]


def _scaled(a, b, scale, z):
    return BETWEEN.residual(a, b, np.column_stack([scale * z[:, :2], z[:, 2:]]))


def _sum_of_ranges(a, b, beacon, scale, z):
    none = np.zeros((len(a), 1))
    return scale * (RANGE.residual(a, beacon, none) + RANGE.residual(b, beacon, none)) - z


WHEELS = FactorKind("wheels", (SE2, SE2, SCALE), 3, 3, _scaled)
TRIANGLE = FactorKind("sum of ranges", (SE2, SE2, POINT2, SCALE), 1, 1, _sum_of_ranges)


def made(kernel=None, wrong=0.0):
    """Return a drive round three beacons, by wheels whose radius is not known, and its start."""
    rng, n = np.random.default_rng(4), 12
    turn = 2.0 * np.pi * np.arange(n) / n
    truth = np.column_stack([3.0 * np.sin(turn), 3.0 - 3.0 * np.cos(turn), turn])
    beacons = np.array([[5.0, 0.0], [-4.0, 2.0], [0.0, 8.0]])
    links = np.column_stack([np.arange(n - 1), np.arange(1, n)])
    steps = BETWEEN.residual(truth[:-1], truth[1:], np.zeros((n - 1, 3)))
    steps[:, :2] /= 1.1
    steps += rng.normal(0.0, 0.01, steps.shape)
    pose, beacon = (each.ravel() for each in np.meshgrid(np.arange(n), np.arange(3)))
    ranges = np.hypot(*(beacons[beacon] - truth[pose, :2]).T)[:, None]
    ranges += rng.normal(0.0, 0.05, ranges.shape)
    ranges[7] += wrong
    builder = GraphBuilder()
    builder.variables(SE2, np.arange(n), truth + rng.normal(0.0, 0.1, truth.shape))
    builder.variables(POINT2, np.arange(3), beacons + rng.normal(0.0, 0.1, beacons.shape))
    builder.variables(SCALE, np.array([0]), np.array([[1.0]]))
    builder.factors(FACTORS["prior_2d"], np.array([[0]]), truth[:1], 1e4 * np.eye(3)[None])
    builder.factors(WHEELS, np.column_stack([links, np.zeros(n - 1, np.int64)]), steps,
                    np.tile(1e4 * np.eye(3), (n - 1, 1, 1)))  # fmt: skip
    builder.factors(RANGE, np.column_stack([pose, beacon]), ranges,
                    np.full((len(pose), 1, 1), 400.0), kernel)  # fmt: skip
    ends = np.array([[1, 5, 0, 0], [2, 9, 1, 0], [3, 11, 2, 0]])
    a, b = (np.hypot(*(beacons[ends[:, 2]] - truth[ends[:, k], :2]).T) for k in (0, 1))
    builder.factors(TRIANGLE, ends, 1.1 * (a + b)[:, None] + 0.02, np.full((3, 1, 1), 100.0))
    graph, values, _ = builder.build()
    return graph, values


def moved(graph, values, x):
    """Return values after increments x of all variables, kind after kind."""
    result, at = {}, 0
    for kind in graph.ids:
        n = len(graph.ids[kind]) * kind.dof
        result[kind] = kind.retract(values[kind], x[at : at + n].reshape(-1, kind.dof))
        at += n
    return result


def residuals(graph, values):
    """Return all residuals over their standard deviations; of a kernel, the root of its cost."""
    parts = []
    for block in graph.blocks:
        r = block.kind.residual(*values_of(block, values), block.measurements)
        r = np.einsum("nij,nj->ni", np.linalg.cholesky(block.information).transpose(0, 2, 1), r)
        if block.kernel is not None:
            cost = block.kernel.cost(np.sum(r**2, axis=1), scale(block.kind.size))
            r = np.sign(r) * np.sqrt(cost)[:, None]
        parts.append(r.ravel())
    return np.concatenate(parts)


def smoothed(graph, values):
    """Return a smoother that was given all factors one by one, and the numbers of variables."""
    smoother = IncrementalSmoother(SmootherConfig(relinearise=0.01, wildfire=0.0))
    numbers = {kind: [smoother.variable(kind, each) for each in values[kind]] for kind in graph.ids}
    for block in graph.blocks:
        for ends, z, information in zip(
            zip(*block.variables, strict=True), block.measurements, block.information, strict=True
        ):
            at = [numbers[k][i] for k, i in zip(block.kind.variables, ends, strict=True)]
            smoother.factor(block.kind, at, z, information, block.kernel)
            smoother.update()
    smoother.refine(60)
    return smoother, numbers


def optimum(graph, values):
    """Return the values that scipy finds, and the Jacobian of residuals by increments there."""
    size = int(graph.dof().sum())
    found = least_squares(lambda x: residuals(graph, moved(graph, values, x)), np.zeros(size),
                          xtol=1e-14, ftol=1e-14, gtol=1e-14)  # fmt: skip
    at = moved(graph, values, found.x)
    eye, h = np.eye(size), 1e-6
    columns = [
        (residuals(graph, moved(graph, at, h * e)) - residuals(graph, moved(graph, at, -h * e)))
        / (2.0 * h)
        for e in eye
    ]
    return at, 2.0 * found.cost, np.column_stack(columns)


def test_factors_of_three_and_four_variables_have_scipys_optimum_and_marginals():
    graph, start = made()
    wanted, cost, J = optimum(graph, start)
    P = np.linalg.inv(J.T @ J)
    solution = SOLVERS["lm"](Problem(graph, start, np.empty(0, np.int64)), nobody)
    assert solution.chi2[-1] == pytest.approx(cost, rel=1e-6)
    smoother, numbers = smoothed(graph, start)
    equations = factored(graph, solution.values, np.empty(0, np.int64), solution.weights)
    at = 0
    for kind, ids in graph.ids.items():
        for row in range(len(ids)):
            np.testing.assert_allclose(solution.values[kind][row], wanted[kind][row], atol=1e-4)
            number = numbers[kind][row]
            np.testing.assert_allclose(smoother.estimate(number), wanted[kind][row], atol=1e-3)
            exact = P[at : at + kind.dof, at : at + kind.dof]
            own = marginals(equations, [graph.first(kind) + row])[0]
            np.testing.assert_allclose(own, exact, atol=1e-3 * np.abs(exact).max())
            online = smoother.covariance(number)
            np.testing.assert_allclose(online, exact, atol=1e-2 * np.abs(exact).max())
            at += kind.dof
    assert solution.values[SCALE][0, 0] == pytest.approx(1.1, abs=0.01)


@pytest.mark.parametrize("name", ["cauchy", "huber"])
def test_a_kernel_of_their_own_holds_some_factors_only(name):
    graph, start = made(KERNELS[name], wrong=4.0)
    wanted, cost, _ = optimum(graph, start)
    solution = SOLVERS["lm"](Problem(graph, start, np.empty(0, np.int64)), nobody)
    smoother, numbers = smoothed(graph, start)
    for kind in graph.ids:
        np.testing.assert_allclose(solution.values[kind], wanted[kind], atol=2e-3)
        for row, number in enumerate(numbers[kind]):
            np.testing.assert_allclose(smoother.estimate(number), wanted[kind][row], atol=5e-3)
    assert smoother.chi2() == pytest.approx(cost, rel=1e-3)
    weights = dict(zip((each.kind for each in graph.blocks), solution.weights, strict=True))
    assert weights[RANGE][7] < 0.3
    assert np.all(weights[WHEELS] == 1.0)
    # Without the kernel the wrong range bends all.
    plain = FactorGraph(graph.ids, tuple(
        type(each)(each.kind, each.variables, each.measurements, each.information)
        for each in graph.blocks))  # fmt: skip
    bent = SOLVERS["lm"](Problem(plain, start, np.empty(0, np.int64)), nobody)
    assert np.abs(bent.values[SE2] - solution.values[SE2]).max() > 0.1


@pytest.mark.parametrize("name", ["gbp", "ekf"])
def test_solvers_for_pairs_say_what_they_cannot_take(name):
    graph, start = made()
    with pytest.raises(GraphError, match=f"{name} takes .* 'wheels' of pose of 3 numbers"):
        SOLVERS[name](Problem(graph, start, np.empty(0, np.int64)), nobody)


def test_a_factor_must_not_link_a_variable_with_itself():
    builder = GraphBuilder()
    builder.factors(WHEELS, np.array([[1, 1, 0]]), np.zeros((1, 3)), np.eye(3)[None])
    with pytest.raises(ValueError, match="with itself"):
        builder.build()
