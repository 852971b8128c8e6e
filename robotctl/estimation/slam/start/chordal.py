"""The chordal relaxation: rotations as free matrices, by linear least squares, then positions.

Two linear solutions replace a start that may be far off. Rotations: sum of kappa |R_j - R_i Z|^2
over matrices that need not be rotations, which are then projected onto rotations (Martinec and
Pajdla, CVPR 2007; Carlone, Tron, Daniilidis and Dellaert, Initialization techniques for 3D SLAM,
ICRA 2015). Positions: the translations as measured, turned by these.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from native_kernels.compiled import compiled
from robotctl.estimation.slam.equations import NormalEquations
from robotctl.estimation.slam.factors.between import BETWEEN_2D, BETWEEN_3D
from robotctl.estimation.slam.factors.rotations import matrix
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, blocks_of
from robotctl.estimation.slam.graph.variables import POINT2, POINT3, SE3, Floats, VariableKind
from robotctl.estimation.slam.start.spanning import parts_of


@compiled
def _linear(a: Floats, b: Floats, z: Floats, residuals: Floats, by_a: Floats, by_b: Floats) -> None:
    """Fill b - M a - t, with M (d, d) and t (d,) as measurement (n, d * d + d)."""
    d = a.shape[1]
    for k in range(len(z)):
        for i in range(d):
            total = b[k, i] - z[k, d * d + i]
            for j in range(d):
                total -= z[k, i * d + j] * a[k, j]
                by_a[k, i, j] = -z[k, i * d + j]
                by_b[k, i, j] = 1.0 if i == j else 0.0
            residuals[k, i] = total


def _residual(a: Floats, b: Floats, z: Floats) -> Floats:
    d = a.shape[1]
    M = z[:, : d * d].reshape(-1, d, d)
    result: Floats = b - np.einsum("nij,nj->ni", M, a) - z[:, d * d :]
    return result


_LINEAR: Final = {
    kind: FactorKind(
        "linear", (kind, kind), kind.dof * (kind.dof + 1), kind.dof, _residual, _linear
    )
    for kind in (POINT2, POINT3)
}


@compiled
def matrices(quaternions: Floats) -> Floats:
    """Return rotation matrices (n, 3, 3) of unit quaternions x, y, z, w (n, 4)."""
    result = np.empty((len(quaternions), 3, 3))
    for k in range(len(quaternions)):
        matrix(quaternions[k], result[k])
    return result


def quaternions(rotations: Floats) -> Floats:
    """Return unit quaternions x, y, z, w (n, 4) of rotation matrices (n, 3, 3)."""
    R = rotations
    # The eigenvector of the greatest eigenvalue: Bar-Itzhack, J. Guidance 23 (2000).
    K = np.empty((len(R), 4, 4))
    K[:, 0, 0] = R[:, 0, 0] - R[:, 1, 1] - R[:, 2, 2]
    K[:, 1, 1] = R[:, 1, 1] - R[:, 0, 0] - R[:, 2, 2]
    K[:, 2, 2] = R[:, 2, 2] - R[:, 0, 0] - R[:, 1, 1]
    K[:, 3, 3] = R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2]
    K[:, 0, 1] = K[:, 1, 0] = R[:, 0, 1] + R[:, 1, 0]
    K[:, 0, 2] = K[:, 2, 0] = R[:, 0, 2] + R[:, 2, 0]
    K[:, 1, 2] = K[:, 2, 1] = R[:, 1, 2] + R[:, 2, 1]
    K[:, 0, 3] = K[:, 3, 0] = R[:, 2, 1] - R[:, 1, 2]
    K[:, 1, 3] = K[:, 3, 1] = R[:, 0, 2] - R[:, 2, 0]
    K[:, 2, 3] = K[:, 3, 2] = R[:, 1, 0] - R[:, 0, 1]
    result: Floats = np.linalg.eigh(K)[1][:, :, -1]
    return result


def chordal_poses(graph: FactorGraph, tree: Floats, fixed: Ints) -> Floats:
    """Return poses (n, size) by the chordal relaxation.

    Parameters
    ----------
    graph
        With poses; in a part that no measured pose links to a fixed one, the first pose keeps the
        value it has.
    tree
        Poses along a tree, (n, size); the fixed ones keep theirs.
    fixed
        Rows of fixed poses.
    """
    is_space = tree.shape[1] == SE3.size
    blocks = blocks_of(graph, BETWEEN_3D if is_space else BETWEEN_2D)
    part = parts_of(graph)
    is_held = np.isin(part, part[fixed], invert=True)
    firsts = np.unique(part, return_index=True)[1]
    held = np.unique(np.concatenate([fixed, firsts[is_held[firsts]]]))
    if len(held) == len(tree):
        return tree
    first = np.concatenate([block.variables[0] for block in blocks])
    second = np.concatenate([block.variables[1] for block in blocks])
    z = np.concatenate([block.measurements for block in blocks])
    information = np.concatenate([block.information for block in blocks])
    if is_space:
        return _in_space(tree, held, first, second, z, information)
    return _in_plane(tree, held, first, second, z, information)


def _solve(
    kind: VariableKind, ends: tuple[Ints, Ints], maps: Floats, information: Floats, held: Ints,
    starts: list[Floats],
) -> list[Floats]:  # fmt: skip
    """Return the least-squares solutions b = M a + t that begin with each of some values."""
    block = FactorBlock(_LINEAR[kind], ends, maps, information)
    graph = FactorGraph({kind: np.arange(len(starts[0]))}, (block,))
    equations = NormalEquations(graph, held)
    results: list[Floats] = []
    for start in starts:
        at = equations.linearise({kind: start})
        equations.assemble(at)
        if not results and equations.factorise() is not None:
            return starts
        results.append(equations.retract({kind: start}, equations.solve())[kind])
    return results


def _in_plane(
    tree: Floats, held: Ints, first: Ints, second: Ints, z: Floats, information: Floats
) -> Floats:
    c, s = np.cos(z[:, 2]), np.sin(z[:, 2])
    nothing = np.zeros_like(c)
    maps = np.column_stack([c, -s, s, c, nothing, nothing])
    weight = information[:, 2, 2, None, None] * np.eye(2)
    directions = np.column_stack([np.cos(tree[:, 2]), np.sin(tree[:, 2])])
    (turned,) = _solve(POINT2, (first, second), maps, weight, held, [directions])
    theta = np.arctan2(turned[:, 1], turned[:, 0])
    theta[held] = tree[held, 2]
    c, s = np.cos(theta[first]), np.sin(theta[first])
    R = np.stack([np.column_stack([c, -s]), np.column_stack([s, c])], axis=1)
    shift = np.einsum("nij,nj->ni", R, z[:, :2])
    maps = np.column_stack([np.tile([1.0, 0.0, 0.0, 1.0], (len(z), 1)), shift])
    own = _rotated_information(R, z[:, 2], information[:, :2, :2])
    (positions,) = _solve(POINT2, (first, second), maps, own, held, [tree[:, :2].copy()])
    return np.column_stack([positions, theta])


def _rotated_information(R: Floats, turn: Floats, information: Floats) -> Floats:
    """Return the information (n, 2, 2) of translations, of the frame of the end, in the world."""
    c, s = np.cos(turn), np.sin(turn)
    Z = np.stack([np.column_stack([c, -s]), np.column_stack([s, c])], axis=1)
    return _turned(R @ Z, information)


def _turned(R: Floats, information: Floats) -> Floats:
    turned = np.einsum("nij,njk,nlk->nil", R, information, R)
    return np.ascontiguousarray(turned)


def _in_space(
    tree: Floats, held: Ints, first: Ints, second: Ints, z: Floats, information: Floats
) -> Floats:
    Z = matrices(np.ascontiguousarray(z[:, 3:]))
    maps = np.column_stack([Z.transpose(0, 2, 1).reshape(-1, 9), np.zeros((len(z), 3))])
    kappa = np.trace(information[:, 3:, 3:], axis1=1, axis2=2)
    weight = kappa[:, None, None] * np.eye(3)
    R = matrices(np.ascontiguousarray(tree[:, 3:]))
    # Row i of R_j is that of R_i turned by Z^T: three systems with one matrix.
    rows = _solve(
        POINT3, (first, second), maps, weight, held,
        [np.ascontiguousarray(R[:, i]) for i in range(3)],
    )  # fmt: skip
    U, _, V = np.linalg.svd(np.stack(rows, axis=1))
    U[:, :, 2] *= np.linalg.det(U @ V)[:, None]
    R = U @ V
    q = quaternions(R)
    q[held] = tree[held, 3:]
    shift = np.einsum("nij,nj->ni", R[first], z[:, :3])
    maps = np.column_stack([np.tile(np.eye(3).ravel(), (len(z), 1)), shift])
    own = _turned(R[first] @ Z, information[:, :3, :3])
    (positions,) = _solve(
        POINT3, (first, second), maps, own, held, [np.ascontiguousarray(tree[:, :3])]
    )
    return np.column_stack([positions, q])
