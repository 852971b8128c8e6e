"""Fixed variables keep their values, and all else is where dense least squares has it."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.estimation.slam.equations import GraphError
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor_graph import chi2_of
from robotctl.estimation.slam.graph.variables import POINT2, POINT3, SE2, SE3
from robotctl.estimation.slam.marginals import factored, marginals
from robotctl.estimation.slam.robust.kernels import KERNELS
from robotctl.estimation.slam.solvers.anchors import anchors
from robotctl.estimation.slam.solvers.problem import Problem, gauge, nobody
from robotctl.estimation.slam.solvers.registry import CONSISTENT, SOLVERS
from robotctl.estimation.slam.start.registry import STARTS, start_values
from tests.estimation.slam.random_graphs import RandomGraph

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
SEEDS = st.integers(0, 2**32 - 1)
EXACT = tuple(name for name in SOLVERS if name != "ekf")


class Built:
    """A graph of a builder, with some variables fixed by their ids."""

    def __init__(self, builder, *fixed):
        self.graph, self.values, self.known = builder.build()
        names = {self.graph.name(k): k for k in range(self.graph.size)}
        self.fixed = np.array(sorted(names[each] for each in fixed), np.int64)

    def problem(self, init, **options):
        held = gauge(self.graph, self.fixed)
        start = start_values(self.graph, self.values, self.known, held, init)
        return Problem(self.graph, start, held, **options)

    def solve(self, solver, init="chordal", **options):
        return SOLVERS[solver](self.problem(init, **options), nobody)


def add(builder, name, ids, z, sigma=0.1):
    kind = FACTORS[name]
    information = np.eye(kind.size)[None] / sigma**2
    builder.factors(kind, np.array([ids]), np.array([z], float), information)


def check_unmoved(graph, found):
    for kind, row in graph.fixed_places:
        np.testing.assert_array_equal(found[kind][row], graph.given[kind][row])


def is_flexible(graph, best, problem):
    """Return whether the dense equations leave more open than what the solvers hold."""
    J = graph.dense.jacobian(best)
    whole = np.setdiff1d(problem.fixed, graph.fixed)
    held = sum(len(each.coordinates) for each in anchors(graph.graph, best, problem.fixed))
    held += int(graph.graph.dof()[whole].sum())
    return J.size > 0 and J.shape[1] - np.linalg.matrix_rank(J, tol=1e-5) > held


@pytest.mark.parametrize("space", [False, True], ids=["plane", "space"])
@given(seed=SEEDS)
@settings(max_examples=8)
def test_each_start_and_solver_ends_in_the_optimum_of_dense_least_squares(space, seed):
    graph = RandomGraph(seed, space=space)
    best, chi2 = graph.dense.optimum(graph.at_truth())
    fixed = gauge(graph.graph, graph.fixed)
    for init in STARTS:
        start = start_values(graph.graph, graph.values, graph.known, fixed, init)
        check_unmoved(graph, start)
        problem = Problem(graph.graph, start, fixed)
        for name, solver in SOLVERS.items():
            try:
                solution = solver(problem, nobody)
            except GraphError:
                assert is_flexible(graph, best, problem)
                return
            check_unmoved(graph, solution.values)
            found = chi2_of(graph.graph, solution.values)
            assert found == pytest.approx(graph.dense.chi2(solution.values), rel=1e-6, abs=1e-9)
            if name in EXACT or solution.is_converged:
                assert solution.is_converged
                assert found == pytest.approx(chi2, rel=1e-5, abs=1e-5)


@given(seed=SEEDS)
@settings(max_examples=6)
def test_no_robust_kernel_moves_a_fixed_variable(seed):
    graph = RandomGraph(seed)
    fixed = gauge(graph.graph, graph.fixed)
    start = start_values(graph.graph, graph.values, graph.known, fixed, "odometry")
    for name, kernel in KERNELS.items():
        problem = Problem(graph.graph, start, fixed, kernel, name == "gnc")
        try:
            solution = SOLVERS["isam" if name == CONSISTENT else "lm"](problem, nobody)
        except GraphError:
            best, _ = graph.dense.optimum(graph.at_truth())
            assert is_flexible(graph, best, problem)
            return
        check_unmoved(graph, solution.values)
        assert np.isfinite(solution.chi2[-1])


def between_landmarks(*fixed):
    """Return three poses in a row that see three landmarks; the first pose is at 0.5."""
    builder, marks = GraphBuilder(), {10: (1, 1), 11: (2, -1), 12: (0, 2)}
    builder.variables(SE2, np.arange(3), np.array([[0, 0, 0], [1.1, 0.05, 0.02], [2.2, 0.1, 0]]))
    builder.variables(POINT2, np.array(list(marks)), np.array(list(marks.values()), float))
    for k in range(2):
        add(builder, "between_2d", (k, k + 1), (1.0, 0.0, 0.0))
    for pose in range(3):
        for mark, (x, y) in marks.items():
            add(builder, "seen_2d", (pose, mark), (x - 0.5 - pose, y), 0.03)
    return Built(builder, *fixed)


@pytest.mark.parametrize("init", STARTS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_known_landmarks_stay_and_tell_where_the_poses_are(init, solver):
    file = between_landmarks("point 10", "point 11", "point 12")
    problem = file.problem(init)
    np.testing.assert_array_equal(problem.fixed, file.fixed)
    solution = SOLVERS[solver](problem, nobody)
    # The filter is not told of landmarks seen later, from the file's start 0.5 m off.
    assert solution.values[SE2] == pytest.approx(
        np.array([[0.5, 0, 0], [1.5, 0, 0], [2.5, 0, 0]]), abs=0.01 if solver == "ekf" else 1e-6
    )
    np.testing.assert_array_equal(solution.values[POINT2], file.values[POINT2])


def test_one_known_landmark_leaves_only_the_turn_about_it_to_be_held():
    file = between_landmarks("point 10")
    problem = file.problem("odometry")
    (held,) = anchors(file.graph, problem.start, problem.fixed)
    assert held.name(file.graph) == "pose 0: rotation"
    for solver in SOLVERS:
        found = file.solve(solver, "odometry").values
        np.testing.assert_array_equal(found[POINT2][0], (1.0, 1.0))
        assert np.linalg.norm(found[SE2][0, :2] - (1.0, 1.0)) == pytest.approx(np.hypot(0.5, 1.0))
        assert found[SE2][0, 2] == pytest.approx(0.0, abs=1e-6)


def test_parts_that_only_fixed_variables_join_turn_each_by_itself():
    builder = GraphBuilder()
    builder.variables(POINT2, np.array([9]), np.array([[3.0, 0.0]]))
    for first in (0, 5):
        add(builder, "between_2d", (first, first + 1), (1.0, 0.0, 0.0))
        add(builder, "seen_2d", (first, 9), (2.0, 0.5))
    file = Built(builder, "point 9")
    problem = file.problem("odometry")
    held = [each.name(file.graph) for each in anchors(file.graph, problem.start, problem.fixed)]
    assert held == ["pose 0: rotation", "pose 5: rotation"]
    assert file.solve("gn", "odometry").chi2[-1] == pytest.approx(0.0, abs=1e-12)


def test_positions_in_space_leave_a_turn_about_the_line_through_them():
    builder = GraphBuilder()
    for k in range(2):
        add(builder, "between_3d", (k, k + 1), (1.0, 0, 0, 0, 0, 0, 1))
    names = ["rotation about x, rotation about y, rotation about z", "rotation about x"]
    for k, wanted in enumerate(names):
        add(builder, "position_3d", (k,), (7.0 + k, 8.0, 9.0))
        file = Built(builder)
        problem = file.problem("tree")
        assert len(problem.fixed) == 0
        (held,) = anchors(file.graph, problem.start, problem.fixed)
        assert held.name(file.graph) == f"pose 0: {wanted}"
        for solver in EXACT:
            found = file.solve(solver, "tree").values[SE3]
            assert found[0, :3] == pytest.approx((7.0, 8.0, 9.0), abs=1e-6)
    add(builder, "position_3d", (2,), (8.0, 9.0, 9.0))
    file = Built(builder)
    assert not anchors(file.graph, file.solve("lm", "tree").values, gauge(file.graph))


def test_what_stood_together_at_the_start_is_not_held_where_it_turns_out_to_stand_apart():
    builder = GraphBuilder()
    builder.variables(SE2, np.arange(2), np.zeros((2, 3)))  # a program that filled in nothing
    add(builder, "between_2d", (0, 1), (1.0, 0.0, 0.0))
    for k in range(2):
        add(builder, "position_2d", (k,), (0.0, float(k)))
    solution = Built(builder).solve("lm", "file")
    assert solution.chi2[-1] == pytest.approx(0.0, abs=1e-9)
    assert solution.values[SE2][0] == pytest.approx((0.0, 0.0, np.pi / 2), abs=1e-4)


@pytest.mark.parametrize("name", ["bearing", "range"])
def test_a_drive_is_found_by_bearings_or_ranges_of_known_points_wherever_the_file_has_it(name):
    rng, builder = np.random.default_rng(5), GraphBuilder()
    truth = np.array([[40.0, -30.0, 2.5], [39.2, -29.4, 2.0], [38.8, -28.5, 1.0]])
    marks = truth[0, :2] + rng.uniform(-6.0, 6.0, (4, 2))
    builder.variables(POINT2, 10 + np.arange(4), marks)
    builder.variables(SE2, np.arange(3), np.zeros((3, 3)))
    nothing = np.zeros((1, 3))
    for k in range(2):
        z = FACTORS["between_2d"].residual(truth[k : k + 1], truth[k + 1 : k + 2], nothing)[0]
        add(builder, "between_2d", (k, k + 1), z)
    for k in range(3):
        for m, mark in enumerate(marks):
            z = FACTORS[name].residual(truth[k : k + 1], mark[None], np.zeros((1, 1)))[0]
            add(builder, name, (k, 10 + m), z)
    file = Built(builder, *(f"point {10 + m}" for m in range(4)))
    for init in ("odometry", "tree", "chordal"):
        for solver in EXACT:
            assert file.solve(solver, init).values[SE2] == pytest.approx(truth, abs=1e-3)


@pytest.mark.parametrize("solver", SOLVERS)
def test_where_all_is_fixed_the_chi2_is_that_of_what_stands_there(solver):
    marks = ("point 10", "point 11", "point 12")
    file = between_landmarks("pose 0", "pose 1", "pose 2", *marks)
    for init in STARTS:
        problem = file.problem(init)
        solution = SOLVERS[solver](problem, nobody)
        assert solution.chi2 == [pytest.approx(chi2_of(file.graph, file.values))]
        assert solution.is_converged
        ones = [np.ones(len(each)) for each in file.graph.blocks]
        equations = factored(file.graph, solution.values, problem.fixed, ones)
        np.testing.assert_array_equal(marginals(equations, [0, 3])[0], np.zeros((3, 3)))


@pytest.mark.parametrize("solver", SOLVERS)
def test_where_all_poses_are_fixed_landmarks_are_mapped(solver):
    builder, x = GraphBuilder(), np.array([0.0, 2.2, 4.4])
    builder.variables(SE2, np.arange(3), np.column_stack([x, np.zeros(3), np.zeros(3)]))
    for k in range(2):
        add(builder, "between_2d", (k, k + 1), (2.0, 0.0, 0.0))
    for k in range(3):
        add(builder, "seen_2d", (k, 10), (1.0 - x[k], 2.0))
    file = Built(builder, *(f"pose {k}" for k in range(3)))
    for init in STARTS:
        solution = file.solve(solver, init)
        np.testing.assert_array_equal(solution.values[SE2], file.values[SE2])
        assert solution.values[POINT2][0] == pytest.approx((1.0, 2.0), abs=1e-9)
        assert solution.chi2[-1] == pytest.approx(2 * 100 * 0.2**2)


def test_a_fixed_pose_heeds_neither_its_own_prior_nor_a_heading_beyond_half_a_turn():
    builder = GraphBuilder()
    for k in range(3):
        add(builder, "between_2d", (k, k + 1), (1.0, 0.0, np.pi / 2))
    add(builder, "prior_2d", (2,), (9.0, 9.0, 0.5))
    given = np.array([[0, 0, 0], [1, 0, 1.5], [1.0, 1.0, 3.5 * np.pi], [0, 1, -1.5]])
    builder.variables(SE2, np.arange(4), given)
    file = Built(builder, "pose 2")
    for init in STARTS:
        for solver in SOLVERS:
            found = file.solve(solver, init).values[SE2]
            np.testing.assert_array_equal(found[2], given[2])
            # The way back from pose 2, whatever the prior says. The filter guesses at first, and
            # has let go of pose 0 before it meets pose 2.
            exact = 0.1 if solver == "ekf" else 1e-6
            assert found[1, :2] == pytest.approx((2.0, 1.0), abs=exact)
            if solver != "ekf":
                assert found[0, :2] == pytest.approx((2.0, 0.0), abs=exact)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("kinds", [(SE2, POINT2), (SE3, POINT3)], ids=["plane", "space"])
def test_what_no_factor_names_keeps_its_place(solver, kinds):
    builder = GraphBuilder()
    pose, point = kinds
    z = (1.0, 0.0, 0.3) if pose is SE2 else (1.0, 0, 0, 0, 0, 0, 1)
    add(builder, "between_2d" if pose is SE2 else "between_3d", (0, 1), z)
    lonely = np.array(pose.identity)
    lonely[:2] = 4.0, 5.0
    builder.variables(pose, np.array([7]), lonely[None])
    builder.variables(point, np.array([10]), np.full((1, point.size), 2.0))
    file = Built(builder)
    for kernel in (None, KERNELS[CONSISTENT]) if solver == "isam" else (None,):
        solution = file.solve(solver, "odometry", kernel=kernel)
        np.testing.assert_array_equal(solution.values[pose][2], lonely)
        np.testing.assert_array_equal(solution.values[point][0], np.full(point.size, 2.0))


def test_the_filter_says_that_it_has_converged_only_where_it_has():
    straight, loop = GraphBuilder(), GraphBuilder()
    for k in range(5):
        for builder in (straight, loop):
            add(builder, "between_2d", (k, k + 1), (1.0, 0.0, 1.0))
    add(loop, "between_2d", (0, 5), (0.5, 0.5, -1.0))
    assert Built(straight).solve("ekf", "odometry").is_converged
    file = Built(loop)
    found, best = (file.solve(name, "odometry") for name in ("ekf", "lm"))
    assert found.chi2[-1] > 1.01 * best.chi2[-1]
    assert not found.is_converged


def test_steps_that_leave_all_bounds_are_told_and_never_end_in_no_number():
    builder = GraphBuilder()
    builder.variables(SE2, np.arange(2), np.array([[0.0, 0, 0], [1e25, 0, 0]]))
    builder.variables(POINT2, np.array([9]), np.array([[1.0, 1.0]]))
    add(builder, "between_2d", (0, 1), (1.0, 0.0, 0.0), sigma=1e-12)
    for pose in range(2):
        add(builder, "bearing", (pose, 9), (3.0 * pose,), sigma=1e-9)
    file = Built(builder)
    for solver in SOLVERS:
        with contextlib.suppress(GraphError):
            assert np.isfinite(file.solve(solver, "file").chi2[-1])
