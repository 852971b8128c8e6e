"""Filtering of a graph: the last pose is that of the batch, whatever was marginalised out."""

import numpy as np
import pytest

from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import POINT2, SE2, SE3
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.solvers.filtering import GraphFilter, departures, most_at_once
from robotctl.estimation.slam.solvers.incremental import arrivals
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import SOLVERS
from robotctl.estimation.slam.start.registry import start_values
from robotctl.logs.graphs.graph_files import read_graph

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
SIGMA = 1e-4
"""Small, so that filter and batch see the same linear problem."""
POSES = 20


def problem_of(builder):
    graph, values, known = builder.build()
    fixed = gauge(graph)
    return Problem(graph, start_values(graph, values, known, fixed, "odometry"), fixed)


def mixed(rng, n, size):
    """Return information matrices with all directions mixed."""
    A = np.eye(size) + 0.3 * rng.standard_normal((n, size, size))
    return A @ A.transpose(0, 2, 1) / SIGMA**2


def pairs(rng):
    return np.array(
        [(k, k + 1) for k in range(POSES - 1)]
        + [sorted(rng.choice(POSES, 2, replace=False)) for _ in range(8)]
    )


def plane(seed):
    """Return a drive in the plane far from the origin, loops, and points seen several times."""
    rng, builder = np.random.default_rng(seed), GraphBuilder()
    truth = np.cumsum(rng.uniform(-1.0, 1.0, (POSES, 3)), axis=0) + np.array([30.0, -20.0, 1.0])
    truth[0] = 0.0
    ids, between = pairs(rng), FACTORS["between_2d"]
    a, b = truth[ids[:, 0]], truth[ids[:, 1]]
    z = between.residual(a, b, np.zeros_like(a)) + SIGMA * rng.standard_normal(a.shape)
    builder.factors(between, ids, z, mixed(rng, len(ids), 3))
    seen = np.array([(k, 100 + k % 3) for k in range(3, 17)])
    marks = rng.uniform(-9.0, 9.0, (3, 2))
    see = FACTORS["seen_2d"]
    z = see.residual(truth[seen[:, 0]], marks[seen[:, 1] - 100], np.zeros((len(seen), 2)))
    z += SIGMA * rng.standard_normal(z.shape)
    builder.factors(see, seen, z, mixed(rng, len(seen), 2))
    return problem_of(builder)


def space(seed):
    """Return a drive in space, with loops."""
    rng, builder = np.random.default_rng(seed), GraphBuilder()
    q = rng.standard_normal((POSES, 4))
    truth = np.column_stack(
        [rng.uniform(-9, 9, (POSES, 3)), q / np.linalg.norm(q, axis=1)[:, None]]
    )
    truth[0] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0
    ids, between = pairs(rng), FACTORS["between_3d"]
    one = np.tile([0.0, 0, 0, 0, 0, 0, 1.0], (len(ids), 1))
    r = between.residual(truth[ids[:, 0]], truth[ids[:, 1]], one)  # translation, vector part
    w = np.sqrt(1.0 - np.sum(r[:, 3:] ** 2, axis=1))
    exact = np.column_stack([r, w])
    z = SE3.retract(exact, SIGMA * rng.standard_normal((len(ids), 6)))
    builder.factors(between, ids, z, mixed(rng, len(ids), 6))
    return problem_of(builder)


def filtered(problem, *, forgets=True):
    """Return the filter after the last pose."""
    steps = arrivals(problem.graph)
    last = departures(problem.graph, steps)
    result = GraphFilter(problem)
    for step, factors in enumerate(steps):
        result.step(factors)
        if forgets and step < len(steps) - 1:
            result.forget([k for k in list(result.members) if last[k] == step])
    return result


@pytest.mark.parametrize("make", [plane, space])
@pytest.mark.parametrize("seed", range(3))
def test_the_last_pose_and_its_covariance_are_those_of_the_batch(make, seed):
    problem = make(seed)
    kind = problem.graph.poses
    batch = SOLVERS["lm"](problem, nobody)
    ones = [np.ones(len(block)) for block in problem.graph.blocks]
    (exact,) = marginals(factored(problem.graph, batch.values, problem.fixed, ones), [POSES - 1])
    own = filtered(problem)
    assert own.covariance(POSES - 1) == pytest.approx(exact, rel=0.02, abs=0.02 * exact.max())
    off = np.abs(own.values[kind][-1] - batch.values[kind][-1])
    assert np.all(off < 0.05 * np.sqrt(exact.max()))
    assert SOLVERS["ekf"](problem, nobody).values[kind] == pytest.approx(own.values[kind])


@pytest.mark.parametrize("make", [plane, space])
def test_what_is_marginalised_out_changes_nothing_for_the_rest(make):
    problem = make(5)
    kind = problem.graph.poses
    small, whole = filtered(problem), filtered(problem, forgets=False)
    assert len(small.members) < len(whole.members) == problem.graph.size - 1
    for number in small.members:
        found, exact = small.covariance(number), whole.covariance(number)
        assert found == pytest.approx(exact, rel=1e-6, abs=1e-6 * exact.max())
    assert small.values[kind][-1] == pytest.approx(whole.values[kind][-1], abs=1e-9)


def test_a_drive_without_loops_is_its_odometry_and_holds_two_poses():
    builder = GraphBuilder()
    ids = np.array([(k, k + 1) for k in range(30)])
    z = np.tile([1.0, 0.1, 0.3], (30, 1))
    builder.factors(FACTORS["between_2d"], ids, z, np.tile(np.eye(3), (30, 1, 1)))
    problem = problem_of(builder)
    steps = arrivals(problem.graph)
    assert most_at_once(steps, departures(problem.graph, steps), problem.graph) == 2
    found = SOLVERS["ekf"](problem, nobody)
    assert found.values[SE2][:, :2] == pytest.approx(problem.start[SE2][:, :2])
    assert found.chi2[-1] == pytest.approx(0.0, abs=1e-9)


def test_points_that_no_single_bearing_places_are_found():
    rng, builder = np.random.default_rng(4), GraphBuilder()
    truth = np.column_stack([np.arange(12.0), np.zeros(12), np.zeros(12)])
    marks = np.array([(2.0, 5.0), (6.0, -3.0)])
    ids = np.array([(k, k + 1) for k in range(11)])
    z = np.diff(truth, axis=0) + 0.01 * rng.standard_normal((11, 3))
    builder.factors(FACTORS["between_2d"], ids, z, np.tile(1e4 * np.eye(3), (11, 1, 1)))
    seen = np.array([(k, 20 + m) for k in range(12) for m in range(2)])
    away = marks[seen[:, 1] - 20] - truth[seen[:, 0], :2]
    angles = np.arctan2(away[:, 1], away[:, 0])[:, None] + 0.01 * rng.standard_normal((24, 1))
    builder.factors(FACTORS["bearing"], seen, angles, np.full((24, 1, 1), 1e4))
    problem = problem_of(builder)
    batch, found = (SOLVERS[name](problem, nobody) for name in ("lm", "ekf"))
    assert found.values[POINT2] == pytest.approx(batch.values[POINT2], abs=0.05)


def test_too_many_poses_that_later_factors_return_to_are_refused():
    n, builder = 2010, GraphBuilder()
    ids = np.array([(k, k + 1) for k in range(n)] + [(k, n) for k in range(n - 1)])
    z = np.zeros((len(ids), 3))
    builder.factors(FACTORS["between_2d"], ids, z, np.tile(np.eye(3), (len(ids), 1, 1)))
    with pytest.raises(GraphError, match=r"hold 201\d variables at once.* at most 2000"):
        SOLVERS["ekf"](problem_of(builder), nobody)


@pytest.mark.recordings("posegraph")
def test_the_last_pose_of_intel_is_where_the_batch_has_it(recordings):
    file = read_graph(recordings / "posegraph" / "intel.g2o")
    fixed = gauge(file.graph, file.fixed)
    start = start_values(file.graph, file.values, file.known, fixed, "odometry")
    problem = Problem(file.graph, start, fixed)
    batch, found = (SOLVERS[name](problem, nobody).values[SE2] for name in ("lm", "ekf"))
    assert np.linalg.norm((start[SE2] - batch)[-1, :2]) > 2.0
    assert np.linalg.norm((found - batch)[-1, :2]) < 0.05
