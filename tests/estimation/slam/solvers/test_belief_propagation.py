"""Belief propagation: exact on trees, the means of least squares around loops, too sure there."""

import numpy as np
import pytest

from robotctl.estimation.slam.beliefs.linear_graph import LinearGraph
from robotctl.estimation.slam.beliefs.schedules import EmbeddedTree, Residual, Synchronous
from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import Linearised
from robotctl.estimation.slam.graph.factor_graph import values_of
from robotctl.estimation.slam.graph.variables import POINT2, POINT3, SE2, SE3
from robotctl.estimation.slam.solvers.belief_propagation import belief_propagation
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import SOLVERS
from robotctl.estimation.slam.start.registry import start_values
from robotctl.logs.graphs.graph_files import read_graph

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
SCHEDULES = (EmbeddedTree, Synchronous, Residual)
EXACT = 1e-9


def spd(rng, n, size, low=1.0):
    """Return information matrices with all directions mixed."""
    A = rng.standard_normal((n, size, size))
    return 30.0 * (A @ A.transpose(0, 2, 1) + low * np.eye(size))


def poses(seed, n, loops, *, points=0, prior=True):
    """Return poses on a random tree, more links, parallel ones too, points, and a prior."""
    rng, builder = np.random.default_rng(seed), GraphBuilder()
    truth = rng.uniform(-3.0, 3.0, (n, 3))
    pairs = [(int(rng.integers(max(0, k - 4), k)), k) for k in range(1, n)]
    pairs += [tuple(rng.choice(n, 2, replace=False)) for _ in range(loops)]
    pairs += pairs[-loops // 3 :] if loops else []
    ids = np.array([p if rng.random() < 0.5 else p[::-1] for p in pairs])
    a, b = truth[ids[:, 0]], truth[ids[:, 1]]
    between = FACTORS["between_2d"]
    z = between.residual(a, b, np.zeros_like(a)) + 0.05 * rng.standard_normal(a.shape)
    builder.factors(between, ids, z, spd(rng, len(z), 3))
    if points:
        ids = np.array([(rng.integers(n), n + k) for k in range(points)])
        z = rng.uniform(0.5, 2.0, (points, 2))
        builder.factors(FACTORS["seen_2d"], ids, z, spd(rng, points, 2))
    if prior:
        ends = np.array([[n // 2], [n - 1]])
        builder.factors(FACTORS["prior_2d"], ends, truth[ends[:, 0]] + 0.1, spd(rng, 2, 3))
    graph, values, known = builder.build()
    fixed = gauge(graph)
    return graph, start_values(graph, values, known, fixed, "odometry"), fixed


def dense(graph, values, fixed):
    """Return matrix and right side of all variables, row by row of the factors."""
    dof = graph.dof()
    first = np.concatenate([[0], np.cumsum(dof)])
    H, right = np.zeros((first[-1], first[-1])), np.zeros(first[-1])
    for block in graph.blocks:
        at = Linearised.empty(block)
        at.fill(block, values_of(block, values))
        for k, ends in enumerate(np.column_stack(graph.numbers(block))):
            J = np.zeros((block.kind.size, first[-1]))
            for end, each in zip(ends, at.jacobians, strict=True):
                J[:, first[end] : first[end + 1]] = each[k]
            H += J.T @ block.information[k] @ J
            right -= J.T @ block.information[k] @ at.residuals[k]
    for each in fixed:
        own = slice(first[each], first[each + 1])
        H[own], H[:, own], right[own] = 0.0, 0.0, 0.0
        H[own, own] = np.eye(dof[each])
    return H, right, first


def linear(problem, schedule, share=EXACT):
    graph, values, fixed = problem
    result = LinearGraph(graph, fixed, schedule, share)
    result.assemble(result.linearise(values))
    result.factorise()
    return result


def unpadded(graph, rows):
    """Return padded rows (n, D) as one vector."""
    return np.concatenate([row[:dof] for row, dof in zip(rows, graph.dof(), strict=True)])


@pytest.mark.parametrize("make", SCHEDULES)
@pytest.mark.parametrize("seed", range(3))
def test_on_a_tree_means_and_covariances_are_exact(make, seed):
    problem = poses(seed, 25, 0, points=6, prior=seed > 0)
    H, right, first = dense(*problem)
    graph = linear(problem, make())
    x = graph.solve().reshape(graph.scales.shape)
    assert graph.is_settled
    assert unpadded(problem[0], x) == pytest.approx(np.linalg.solve(H, right), abs=1e-7)
    if make is EmbeddedTree:
        assert graph.rounds == 1
        return
    exact = np.linalg.inv(H)
    for k, precision in enumerate(graph.schedule.precisions(graph)):
        own = slice(first[k], first[k + 1])
        if k not in problem[2]:
            width = first[k + 1] - first[k]
            found = np.linalg.inv(precision)[:width, :width]
            assert found == pytest.approx(exact[own, own], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("make", SCHEDULES)
@pytest.mark.parametrize("seed", range(3))
def test_around_loops_means_are_those_of_least_squares(make, seed):
    problem = poses(seed, 30, 15, points=8, prior=seed > 0)
    H, right, _ = dense(*problem)
    graph = linear(problem, make())
    x = graph.solve().reshape(graph.scales.shape)
    assert graph.is_settled
    assert unpadded(problem[0], x) == pytest.approx(np.linalg.solve(H, right), abs=1e-6)


def test_around_loops_beliefs_of_all_schedules_agree_whatever_the_damping_and_are_too_sure():
    problem = poses(7, 30, 15)
    exact = np.linalg.inv(dense(*problem)[0])
    found = []
    for schedule in (Synchronous(), Synchronous(0.5), Residual(), Residual(0.3)):
        graph = linear(problem, schedule, 1e-10)
        graph.solve()
        assert graph.is_settled
        found.append(schedule.beliefs())
        assert found[-1] == pytest.approx(found[0], rel=1e-6, abs=1e-6 * np.abs(found[0]).max())
    free = np.setdiff1d(np.arange(30), problem[2])
    blocks = np.array([exact[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in free])
    shares = np.linalg.det(np.linalg.inv(found[0][free, :, :-1])) / np.linalg.det(blocks)
    assert np.all(shares < 1.0 + 1e-9)
    assert np.median(shares) < 0.95


@pytest.mark.parametrize("make", SCHEDULES)
def test_means_are_never_farther_off_than_said(make):
    problem = poses(11, 60, 40)
    H, right, _ = dense(*problem)
    exact = np.linalg.solve(H, right)
    sigmas = np.sqrt(np.diag(np.linalg.inv(H)))
    graph, schedule = linear(problem, make()), make()
    schedule.begin(graph)
    said = []
    for _ in range(80):
        means = schedule.round(graph)
        off = unpadded(problem[0], means.x) - exact
        assert np.sqrt(off @ H @ off) <= means.left * (1.0 + 1e-6) + 1e-7
        assert np.max(np.abs(off) / sigmas) <= means.left * (1.0 + 1e-6) + 1e-7
        said.append(means.left)
    assert said[-1] < 0.1 * said[0]


@pytest.mark.parametrize("make", [Synchronous, Residual])
def test_messages_are_kept_for_the_next_linearisation(make):
    graph, values, fixed = poses(3, 40, 20)
    optimum = SOLVERS["lm"](Problem(graph, values, fixed), nobody).values
    near = {SE2: optimum[SE2] + 0.01 * np.random.default_rng(0).standard_normal((40, 3))}
    equations, cold = linear((graph, near, fixed), make(), 1e-6), make()
    moved = equations.retract(near, equations.solve())
    equations.assemble(equations.linearise(moved))
    equations.factorise()
    left = []
    for each in (equations.schedule, cold):
        each.begin(equations)
        left.append(each.round(equations).left)
    assert left[0] < 0.1 * left[1]


@pytest.mark.parametrize("make", SCHEDULES)
def test_as_a_solver_it_ends_in_the_optimum_of_the_batch(make):
    problem = Problem(*poses(5, 40, 25, points=10))
    batch = SOLVERS["lm"](problem, nobody)
    found = belief_propagation(problem, nobody, make())
    assert found.is_converged
    assert found.chi2[-1] == pytest.approx(batch.chi2[-1], rel=1e-6)
    for kind in (SE2, POINT2):
        assert found.values[kind] == pytest.approx(batch.values[kind], abs=1e-3)


def test_links_that_say_little_each_still_say_it_together():
    rng, builder = np.random.default_rng(4), GraphBuilder()
    truth = np.column_stack([np.arange(8.0), 0.1 * np.arange(8.0) ** 2, np.zeros(8)])
    marks = np.array([(2.0, 5.0), (6.0, -3.0), (4.0, 9.0)])
    ids = np.array([(k, k + 1) for k in range(7)])
    z = np.diff(truth, axis=0) + 0.02 * rng.standard_normal((7, 3))
    builder.factors(FACTORS["between_2d"], ids, z, np.tile(400.0 * np.eye(3), (7, 1, 1)))
    seen = np.array([(k, 20 + m) for k in range(8) for m in range(3)])
    away = marks[seen[:, 1] - 20] - truth[seen[:, 0], :2]
    angles = np.arctan2(away[:, 1], away[:, 0])[:, None] + 0.01 * rng.standard_normal((24, 1))
    builder.factors(FACTORS["bearing"], seen, angles, np.full((24, 1, 1), 1e4))
    graph, values, known = builder.build()
    fixed = gauge(graph)
    problem = Problem(graph, start_values(graph, values, known, fixed, "odometry"), fixed)
    batch, found = (SOLVERS[name](problem, nobody) for name in ("lm", "gbp"))
    assert found.is_converged
    assert found.chi2[-1] == pytest.approx(batch.chi2[-1], rel=1e-6)
    assert found.values[POINT2] == pytest.approx(batch.values[POINT2], abs=1e-3)


def test_in_space_too():
    n, rng, builder = 12, np.random.default_rng(6), GraphBuilder()
    headings = 2.0 * np.pi / n * np.arange(n)
    steps = np.stack([np.cos(headings), np.sin(headings), np.zeros(n)], axis=1)
    turn = np.array([0.0, 0.0, np.sin(np.pi / n), np.cos(np.pi / n)])
    ids = np.array([(k, (k + 1) % n) for k in range(n)])
    z = np.tile([1.0, 0.0, 0.0, *turn], (n, 1))
    z[:, :3] += 0.05 * rng.standard_normal((n, 3))
    builder.factors(FACTORS["between_3d"], ids, z, spd(rng, n, 6))
    seen = np.array([(k, 50 + k % 3) for k in range(n)])
    away = rng.uniform(0.0, 2.0, (3, 3))[seen[:, 1] - 50] - (np.cumsum(steps, axis=0) - steps)
    left = np.stack([-steps[:, 1], steps[:, 0], steps[:, 2]], axis=1)
    where = np.stack([np.sum(away * steps, 1), np.sum(away * left, 1), away[:, 2]], axis=1)
    where += 0.05 * rng.standard_normal((n, 3))
    builder.factors(FACTORS["seen_3d"], seen, where, spd(rng, n, 3))
    graph, values, known = builder.build()
    fixed = gauge(graph)
    problem = Problem(graph, start_values(graph, values, known, fixed, "odometry"), fixed)
    batch, found = (SOLVERS[name](problem, nobody) for name in ("lm", "gbp"))
    assert found.is_converged
    assert found.chi2[-1] == pytest.approx(batch.chi2[-1], rel=1e-6)
    for kind in (SE3, POINT3):
        assert found.values[kind] == pytest.approx(batch.values[kind], abs=1e-3)


def test_messages_that_do_not_settle_are_said_with_what_is_left():
    class Hasty(Synchronous):
        most_rounds = 5

    found = belief_propagation(Problem(*poses(2, 60, 30)), nobody, Hasty())
    assert not found.is_converged
    assert found.left_sigma > 1.0


def test_what_the_factors_do_not_determine_is_named():
    builder = GraphBuilder()
    builder.factors(FACTORS["range"], np.array([[1, 2]]), np.array([[1.0]]), np.ones((1, 1, 1)))
    graph, values, known = builder.build()
    fixed = gauge(graph)
    start = start_values(graph, values, known, fixed, "odometry")
    with pytest.raises(GraphError, match="point 2"):
        SOLVERS["gbp"](Problem(graph, start, fixed), nobody)


@pytest.mark.recordings("posegraph")
@pytest.mark.parametrize("name", ["intel", "CSAIL"])
def test_public_graphs_reach_the_batch_mean_from_odometry(recordings, name):
    file = read_graph(recordings / "posegraph" / f"{name}.g2o")
    fixed = gauge(file.graph, file.fixed)
    start = start_values(file.graph, file.values, file.known, fixed, "odometry")
    batch, found = (
        SOLVERS[each](Problem(file.graph, start, fixed), nobody) for each in ("lm", "gbp")
    )
    assert found.is_converged
    off = np.linalg.norm((found.values[SE2] - batch.values[SE2])[:, :2], axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.001
