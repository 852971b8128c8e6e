"""Sparse equations of graphs, against dense ones of numpy."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robotctl.estimation.slam.equations import NormalEquations, adjacency
from robotctl.estimation.slam.factors.registry import FACTORS
from robotctl.estimation.slam.graph.factor import FactorBlock
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import POINT2, SE2
from robotctl.estimation.slam.linear.cholesky import multiply
from robotctl.estimation.slam.linear.ordering import minimum_degree
from robotctl.estimation.slam.linear.symbolic import analyse
from robotctl.estimation.slam.marginals import marginals

SEEDS = st.integers(0, 2**32 - 1)


def random_graph(rng):
    """Return poses and points with random factors between them, and values; all connected."""
    poses, points = int(rng.integers(2, 25)), int(rng.integers(1, 12))
    chain = np.arange(poses - 1)
    extra = rng.integers(0, poses, (int(rng.integers(0, 2 * poses)), 2))
    extra = extra[extra[:, 0] != extra[:, 1]]
    ends = np.concatenate([np.column_stack([chain, chain + 1]), extra])
    seen = np.column_stack([rng.integers(0, poses, 2 * points), np.arange(2 * points) % points])
    blocks = [
        block(FACTORS["between_2d"], ends, rng),
        block(FACTORS["range_bearing"], seen, rng),
        block(FACTORS["position_2d"], rng.integers(0, poses, (2, 1)), rng),
    ]
    values = {SE2: rng.normal(0.0, 3.0, (poses, 3)), POINT2: rng.normal(0.0, 3.0, (points, 2))}
    return FactorGraph({SE2: np.arange(poses), POINT2: np.arange(points)}, tuple(blocks)), values


def block(kind, ends, rng):
    spread = rng.normal(0.0, 1.0, (len(ends), kind.size, kind.size))
    information = spread @ spread.transpose(0, 2, 1) + np.eye(kind.size)
    z = rng.normal(0.0, 1.0, (len(ends), kind.measurement))
    return FactorBlock(kind, tuple(np.ascontiguousarray(ends.T)), z, information)


def dense(graph, equations, at):
    """Return the dense J^T Omega J and gradient, in the order of the equations."""
    H, g = np.zeros((equations.total, equations.total)), np.zeros(equations.total)
    for part, linearised in zip(graph.blocks, at.blocks, strict=True):
        for k in range(len(part)):
            J = np.zeros((part.kind.size, equations.total))
            numbers = graph.numbers(part)
            for slot, kind in enumerate(part.kind.variables):
                first = equations.columns[numbers[slot][k]]
                if first >= 0:
                    J[:, first : first + kind.dof] += linearised.jacobians[slot][k]
            H += J.T @ part.information[k] @ J
            g += J.T @ part.information[k] @ linearised.residuals[k]
    return H, g


@given(SEEDS)
def test_the_sparse_equations_are_solved_as_dense_ones_are(seed):
    rng = np.random.default_rng(seed)
    graph, values = random_graph(rng)
    equations = NormalEquations(graph, [0] if seed % 2 else [])
    at = equations.linearise(values)
    equations.assemble(at)
    H, g = dense(graph, equations, at)
    np.testing.assert_allclose(equations.gradient, g, atol=1e-9 * (1.0 + np.abs(g).max()))
    x = rng.normal(size=equations.total)
    np.testing.assert_allclose(
        multiply(equations.symbolic, equations.matrix, x), H @ x, rtol=1e-9, atol=1e-9
    )
    damping = 0.1 * np.diag(H)
    assert equations.factorise(damping) is None
    A = H + np.diag(damping)
    np.testing.assert_allclose(A @ equations.solve(), -g, atol=1e-6 * (1.0 + np.abs(g).max()))
    inverse = np.linalg.inv(A)
    for number, covariance in enumerate(marginals(equations, range(graph.size))):
        first = equations.columns[number]
        size = len(covariance)
        wanted = inverse[first : first + size, first : first + size] if first >= 0 else 0.0
        np.testing.assert_allclose(covariance, wanted, rtol=1e-5, atol=1e-9)


@given(SEEDS)
def test_an_order_holds_all_variables_and_those_to_be_last_stand_at_the_end(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    pairs = rng.integers(0, n, (2, int(rng.integers(0, 4 * n))))
    starts, neighbours = adjacency(n, [tuple(pairs)])
    is_last = rng.random(n) < 0.2
    order = minimum_degree(starts, neighbours, rng.integers(1, 7, n), is_last)
    assert sorted(order) == list(range(n))
    assert list(order[n - is_last.sum() :]) == list(np.flatnonzero(is_last))


def test_a_chain_and_a_star_do_not_fill():
    n = 200
    chain = (np.arange(n - 1), np.arange(1, n))
    star = (np.zeros(n - 1, int), np.arange(1, n))
    for pairs in (chain, star):
        starts, neighbours = adjacency(n, [pairs])
        ones = np.ones(n, np.int64)
        order = minimum_degree(starts, neighbours, ones, np.zeros(n, bool))
        position = np.argsort(order)
        below = set()
        for a, b in zip(*pairs, strict=True):
            below.add((min(position[a], position[b]), max(position[a], position[b])))
        symbolic = analyse(starts, neighbours, order, ones)
        # Some zeros are stored where small supernodes are merged; the tree has no fill.
        assert symbolic.panel_starts[-1] < 5 * (2 * n)


def test_a_grid_of_poses_fills_no_more_than_a_good_order_does():
    side = 40
    at = np.arange(side * side).reshape(side, side)
    pairs = (
        np.concatenate([at[:, :-1].ravel(), at[:-1].ravel()]),
        np.concatenate([at[:, 1:].ravel(), at[1:].ravel()]),
    )
    starts, neighbours = adjacency(side * side, [pairs])
    ones = np.ones(side * side, np.int64)
    order = minimum_degree(starts, neighbours, ones, np.zeros(side * side, bool))
    symbolic = analyse(starts, neighbours, order, ones)
    # Nested dissection has 31/4 n log2(side) to first order (George 1973).
    assert symbolic.panel_starts[-1] < 31 / 4 * side**2 * np.log2(side)
