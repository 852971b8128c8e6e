"""Values along a spanning tree of the graph: that of odometry, or the one of fewest steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled
from robotctl.estimation.slam.factors.between import BETWEEN_2D, BETWEEN_3D
from robotctl.estimation.slam.factors.odometry_arc import ODOMETRY_ARC
from robotctl.estimation.slam.graph.factor import Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, blocks_of
from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats
from robotctl.model.geometry import se2


@compiled
def walk(
    starts: Ints, edges: Ints, first: Ints, second: Ints, roots: Ints, together: int
) -> tuple[Ints, Ints]:
    """Return edges in the order in which a breadth-first walk takes them, and its direction.

    Parameters
    ----------
    starts, edges
        The edges at each variable.
    first, second
        Ends of each edge.
    roots
        Variables to begin at, one after the other; those reached already are passed over.
    together
        How many of the first roots begin at once, so that each variable is reached from the
        nearest of them.

    Returns
    -------
    taken, is_backward : ndarray
        Edges, and whether they are walked from second to first (1) or not (0).
    """
    n = len(starts) - 1
    is_reached = np.zeros(n, np.bool_)
    taken, backward, count = np.empty(n, np.int64), np.empty(n, np.int64), 0
    queue = np.empty(n, np.int64)
    at_root = 0
    while at_root < len(roots):
        head, tail = 0, 0
        for k in range(at_root, max(together, at_root + 1)):
            if not is_reached[roots[k]]:
                is_reached[roots[k]] = True
                queue[tail] = roots[k]
                tail += 1
        at_root = max(together, at_root + 1)
        while head < tail:
            here = queue[head]
            head += 1
            for at in range(starts[here], starts[here + 1]):
                edge = edges[at]
                is_backward = 1 if second[edge] == here else 0
                there = first[edge] if is_backward else second[edge]
                if not is_reached[there]:
                    is_reached[there] = True
                    queue[tail] = there
                    tail += 1
                    taken[count], backward[count] = edge, is_backward
                    count += 1
    return taken[:count], backward[:count]


@compiled
def _join(first: Ints, second: Ints, order: Ints, n: int) -> NDArray[np.bool_]:
    """Return which edges a spanning forest has that prefers those at the beginning of `order`."""
    parent = np.arange(n)
    is_kept = np.zeros(len(first), np.bool_)
    for edge in order:
        a, b = first[edge], second[edge]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        while parent[b] != b:
            parent[b] = parent[parent[b]]
            b = parent[b]
        if a != b:
            parent[max(a, b)] = min(a, b)
            is_kept[edge] = True
    return is_kept


def incidence(first: Ints, second: Ints, n: int) -> tuple[Ints, Ints]:
    """Return the edges at each of n variables: where they begin, (n + 1,), and all of them."""
    ends = np.concatenate([first, second])
    order = np.argsort(ends, kind="stable")
    starts = np.searchsorted(ends[order], np.arange(n + 1))
    return starts.astype(np.int64), (order % max(len(first), 1)).astype(np.int64)


@compiled
def compose_2d(a: Floats, z: Floats, is_backward: int, result: Floats) -> None:
    """Write a z, or a z^-1 if backward, poses (3,)."""
    if is_backward == 1:
        theta = a[2] - z[2]
        c, s = np.cos(theta), np.sin(theta)
        result[0], result[1] = a[0] - c * z[0] + s * z[1], a[1] - s * z[0] - c * z[1]
    else:
        theta = a[2] + z[2]
        c, s = np.cos(a[2]), np.sin(a[2])
        result[0], result[1] = a[0] + c * z[0] - s * z[1], a[1] + s * z[0] + c * z[1]
    result[2] = theta - 2.0 * np.pi * np.floor((theta + np.pi) / (2.0 * np.pi))


@compiled
def compose_3d(a: Floats, z: Floats, is_backward: int, result: Floats) -> None:
    """Write a z, or a z^-1 if backward, poses (7,)."""
    sign = -1.0 if is_backward == 1 else 1.0
    x, y, t, w = a[3], a[4], a[5], a[6]
    p, q, r, v = sign * z[3], sign * z[4], sign * z[5], z[6]
    result[3] = w * p + x * v + y * r - t * q
    result[4] = w * q + y * v + t * p - x * r
    result[5] = w * r + t * v + x * q - y * p
    result[6] = w * v - x * p - y * q - t * r
    norm = np.sqrt(result[3] ** 2 + result[4] ** 2 + result[5] ** 2 + result[6] ** 2)
    for i in range(3, 7):
        result[i] /= norm
    if is_backward == 1:
        x, y, t, w = result[3], result[4], result[5], result[6]
    a0, b0, c0 = z[0], z[1], z[2]
    f, g, h = y * c0 - t * b0 + w * a0, t * a0 - x * c0 + w * b0, x * b0 - y * a0 + w * c0
    result[0] = a[0] + sign * (a0 + 2.0 * (y * h - t * g))
    result[1] = a[1] + sign * (b0 + 2.0 * (t * f - x * h))
    result[2] = a[2] + sign * (c0 + 2.0 * (x * g - y * f))


@compiled
def _propagate_2d(
    values: Floats, first: Ints, second: Ints, z: Floats, taken: Ints, backward: Ints
) -> None:
    for k in range(len(taken)):
        edge = taken[k]
        if backward[k] == 1:
            compose_2d(values[second[edge]], z[edge], 1, values[first[edge]])
        else:
            compose_2d(values[first[edge]], z[edge], 0, values[second[edge]])


@compiled
def _propagate_3d(
    values: Floats, first: Ints, second: Ints, z: Floats, taken: Ints, backward: Ints
) -> None:
    for k in range(len(taken)):
        edge = taken[k]
        if backward[k] == 1:
            compose_3d(values[second[edge]], z[edge], 1, values[first[edge]])
        else:
            compose_3d(values[first[edge]], z[edge], 0, values[second[edge]])


def relative_poses(graph: FactorGraph) -> tuple[Ints, Ints, Floats]:
    """Return all measured poses between poses: rows (m,), (m,) and poses (m, size)."""
    kind = SE3 if graph.poses is SE3 else SE2
    blocks = blocks_of(graph, BETWEEN_3D if kind is SE3 else BETWEEN_2D)
    first = [block.variables[0] for block in blocks]
    second = [block.variables[1] for block in blocks]
    poses = [block.measurements for block in blocks]
    for block in blocks_of(graph, ODOMETRY_ARC):
        arcs = [se2.SE2.exp(distance, 0.0, turn) for distance, turn in block.measurements.tolist()]
        first.append(block.variables[0])
        second.append(block.variables[1])
        poses.append(np.array([(each.x_m, each.y_m, each.theta_rad) for each in arcs]))
    none = np.empty(0, np.int64)
    return (
        np.concatenate([none, *first]),
        np.concatenate([none, *second]),
        np.concatenate([np.empty((0, kind.size)), *poses]),
    )


def parts_of(graph: FactorGraph) -> Ints:
    """Return for each pose the number of the part that measured poses link it to, (n,), from 0."""
    kind = SE3 if graph.poses is SE3 else SE2
    links = tuple(block for block in graph.blocks if block.kind.variables == (kind, kind))
    return FactorGraph({kind: graph.ids[kind]}, links).components()


def tree_poses(
    graph: FactorGraph, poses: Floats, fixed: Ints, known: NDArray[np.bool_], *, by_odometry: bool
) -> Floats:
    """Return poses (n, size) along trees from the fixed ones, and a tree of each other component.

    Parameters
    ----------
    graph
        With poses.
    poses
        (n, size); those that a tree begins at are kept.
    fixed
        Rows of fixed poses: each is kept, and others are reached from the nearest.
    known
        Which poses are good to begin at, (n,), in a component without a fixed one; the first is.
    by_odometry
        Whether the tree is made of links between successive poses as far as they go; else it has
        the fewest steps.
    """
    first, second, z = relative_poses(graph)
    n = len(poses)
    if by_odometry:
        order = np.argsort(np.abs(second - first) != 1, kind="stable")
        keep = np.flatnonzero(_join(first, second, order, n))
        first, second, z = first[keep], second[keep], z[keep]
    starts, edges = incidence(first, second, n)
    roots = np.concatenate([fixed, np.argsort(~known, kind="stable")])
    taken, backward = walk(starts, edges, first, second, roots, len(fixed))
    values = poses.copy()
    propagate = _propagate_3d if values.shape[1] == SE3.size else _propagate_2d
    propagate(values, first, second, np.ascontiguousarray(z), taken, backward)
    return values
