"""Arrays that do not fit are refused before a compiled loop sees them."""

import numpy as np
import pytest

from robotctl.estimation.slam.equations import GraphError, linearise
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import FactorBlock
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, chi2_of
from robotctl.estimation.slam.graph.variables import POINT2, SE2, SE3
from robotctl.estimation.slam.incremental.consistency import ConsistentClosures
from robotctl.estimation.slam.incremental.smoother import IncrementalSmoother
from robotctl.estimation.slam.solvers.problem import Problem, gauge
from robotctl.estimation.slam.start.registry import start_values

pytestmark = pytest.mark.timeout(600)  # the first of them compiles
BETWEEN, SPACE, SEEN = FACTORS["between_2d"], FACTORS["between_3d"], FACTORS["seen_2d"]
Z, INFORMATION = np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))
ENDS = np.array([[0, 1], [1, 2]])
SKEW = INFORMATION + np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def with_nan(array, value=np.nan):
    result = array.copy()
    result.flat[-1] = value
    return result


BAD_NUMBERS = [
    (BETWEEN, Z[:, :2], INFORMATION, r"measurements float64 \(2, 2\) found, float64 \(2, 3\) need"),
    (BETWEEN, Z, np.ones(3), r"information float64 \(3,\) found, float64 \(2, 3, 3\) needed"),
    (BETWEEN, Z, INFORMATION[:1], r"information float64 \(1, 3, 3\) found"),
    (BETWEEN, Z, INFORMATION[:, :2, :2], r"information float64 \(2, 2, 2\) found"),
    (BETWEEN, with_nan(Z), INFORMATION, r"measurements\[1\] has a number that is not finite"),
    (BETWEEN, with_nan(Z, -np.inf), INFORMATION, r"measurements\[1\] has a number"),
    (BETWEEN, Z, with_nan(INFORMATION), r"information\[1\] has a number that is not finite"),
    (BETWEEN, Z, with_nan(INFORMATION, 1e31), r"information\[1\] .* above 1e\+30"),
    (BETWEEN, Z, SKEW, r"information\[0\] is not symmetric"),
    (SPACE, np.zeros((2, 7)), np.tile(np.eye(6), (2, 1, 1)), "row 0 has no unit quaternion"),
]


@pytest.mark.parametrize(("kind", "z", "information", "problem"), BAD_NUMBERS)
def test_a_builder_and_a_graph_refuse_what_is_no_measurement(kind, z, information, problem):
    with pytest.raises(ValueError, match=problem):
        GraphBuilder().factors(kind, ENDS, z, information)
    block = FactorBlock(kind, tuple(ENDS.T.copy()), z, information)
    with pytest.raises(ValueError, match=problem):
        FactorGraph({kind.variables[0]: np.arange(3)}, (block,))


@pytest.mark.parametrize(
    ("ids", "problem"),
    [
        (ENDS[:, :1], r"ids int64 \(2, 1\) found"),
        (ENDS[:1], r"ids int64 \(1, 2\) found"),
        (ENDS + 0.5, r"ids float64 \(2, 2\) found, whole numbers"),
    ],
)
def test_a_builder_refuses_what_is_no_id(ids, problem):
    with pytest.raises(ValueError, match=problem):
        GraphBuilder().factors(BETWEEN, ids, Z, INFORMATION)


@pytest.mark.parametrize(
    ("kind", "values", "problem"),
    [
        (SE2, np.zeros((2, 2)), r"values of 'pose': float64 \(2, 2\) found, float64 \(2, 3\)"),
        (SE2, np.full((2, 3), np.nan), "row 0 has a number that is not finite"),
        (SE3, np.zeros((2, 7)), "row 0 has no unit quaternion"),
    ],
)
def test_a_builder_refuses_what_is_no_value(kind, values, problem):
    with pytest.raises(ValueError, match=problem):
        GraphBuilder().variables(kind, np.arange(2), values)


@pytest.mark.parametrize(
    ("variables", "problem"),
    [
        ((np.array([0, 1]), np.array([1, 3])), "variables 1 to 3 found, .* there are 3"),
        ((np.array([0, -1]), np.array([1, 2])), "variables -1 to 0 found"),
        ((np.array([0, 1]), np.array([1])), r"variables int64 \(1,\) found, int64 \(2,\) needed"),
        ((np.array([0, 1]),), "1 variables found, 2 needed"),
        (
            (np.array([0, 1]), np.array([1, 1])),
            r"\[1\] links variable 1 of kind 'pose' with itself",
        ),
        ((np.array([0.0, 1.0]), np.array([1, 2])), r"variables float64 \(2,\) found, int64"),
    ],
)
def test_a_graph_refuses_variables_that_it_has_not(variables, problem):
    block = FactorBlock(BETWEEN, variables, Z, INFORMATION)
    with pytest.raises(ValueError, match=problem):
        FactorGraph({SE2: np.arange(3)}, (block,))


def test_a_graph_refuses_a_factor_whose_kind_of_variable_it_has_not():
    block = FactorBlock(SEEN, tuple(ENDS.T.copy()), Z[:, :2], INFORMATION[:, :2, :2].copy())
    with pytest.raises(ValueError, match="of kind 'point' there are 0"):
        FactorGraph({SE2: np.arange(3)}, (block,))


def chain():
    builder = GraphBuilder()
    builder.factors(BETWEEN, ENDS, Z, INFORMATION)
    return builder.build()


@pytest.mark.parametrize(
    ("start", "problem"),
    [
        ({SE2: np.zeros((3, 2))}, r"values of 'pose': float64 \(3, 2\) found"),
        ({SE2: np.zeros((2, 3))}, r"values of 'pose': float64 \(2, 3\) found"),
        ({POINT2: np.zeros((3, 2))}, "none found of the kind 'pose', 3 needed"),
        ({SE2: np.zeros((3, 3), np.float32)}, "float32 .* found"),
    ],
)
def test_values_of_another_shape_are_refused_wherever_they_enter(start, problem):
    graph, _, known = chain()
    fixed = gauge(graph)
    for enter in (
        lambda: Problem(graph, start, fixed),
        lambda: start_values(graph, start, known, fixed, "chordal"),
        lambda: linearise(graph, start),
        lambda: chi2_of(graph, start),
    ):
        with pytest.raises(ValueError, match=problem):
            enter()


def test_a_problem_refuses_what_has_no_solution():
    graph, values, _ = chain()
    with pytest.raises(ValueError, match="row 2 has a number that is not finite"):
        Problem(graph, {SE2: with_nan(values[SE2])}, gauge(graph))
    with pytest.raises(ValueError, match="fixed: 0 to 3 found; variables go from 0 to 2"):
        Problem(graph, values, np.array([3, 0]))
    with pytest.raises(ValueError, match=r"weights: \[1\] found, .* needed: \[2\]"):
        Problem(graph, values, gauge(graph), weights=[np.ones(1)])
    graph.blocks[0].information[1, 2, 2] = -1.0
    with pytest.raises(ValueError, match=r"information\[1\] has a negative eigenvalue"):
        Problem(graph, values, gauge(graph))


def test_a_smoother_refuses_what_does_not_fit():
    smoother = IncrementalSmoother()
    a, b = (smoother.variable(SE2, np.full(3, float(k))) for k in range(2))
    point = smoother.variable(POINT2, np.zeros(2))
    for add in (smoother.factor, ConsistentClosures(smoother).add):
        for ends, problem in (
            ((a, point), "'between poses' of variables .* pose of 3 numbers, point of 2 numbers f"),
            ((a, 3), "pose of 3 numbers found, pose of 3 numbers, pose of 3 numbers needed"),
            ((a, -1), "pose of 3 numbers found"),
            ((a, a), "of variables"),
        ):
            with pytest.raises(ValueError, match=problem):
                add(BETWEEN, ends, Z[0], np.eye(3))
        for z, information, problem in (
            (Z[0, :2], np.eye(3), r"measurements float64 \(1, 2\) found"),
            (with_nan(Z[0]), np.eye(3), "not finite"),
            (Z[0], np.eye(2), r"information float64 \(1, 2, 2\) found"),
            (Z[0], with_nan(np.eye(3)), "not finite"),
            (Z[0], SKEW[0], "not symmetric"),
        ):
            with pytest.raises(ValueError, match=problem):
                add(BETWEEN, (a, b), z, information)
    with pytest.raises(ValueError, match="values of 'pose'"):
        smoother.variable(SE2, np.zeros(2))
    with pytest.raises(ValueError, match="not finite"):
        smoother.variable(POINT2, np.array([0.0, np.inf]))


def test_a_smoother_whose_values_left_all_bounds_says_so_instead_of_trying_for_ever():
    smoother = IncrementalSmoother()
    a, b = (smoother.variable(SE2, np.zeros(3), fixed=k == 0) for k in range(2))
    smoother.factor(BETWEEN, (a, b), Z[0], np.eye(3))
    smoother._variables[SE2].values.array[1] = np.nan
    with pytest.raises(GraphError, match="values have left all bounds"):
        smoother.update()
