"""How variables move when the world they are in moves as a whole."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats, VariableKind
from robotctl.estimation.slam.start.chordal import matrices


def twist_increments(kind: VariableKind, values: Floats, centres: Floats) -> Floats:
    """Return how variables move with the world, (n, dof, k): increments by a twist of it.

    Parameters
    ----------
    kind, values
        Of the variables, (n, size).
    centres
        What the world turns about, (n, d) or (d,): three numbers of the twist are a shift x, y, z
        [m], three a turn about these axes [rad]; in the plane x, y and a turn.
    """
    d, n = kind.positions, len(values)
    away = values[:, :d] - centres
    by_turn = np.zeros((n, d, 1 if d == 2 else 3))
    if d == 2:
        by_turn[:, :, 0] = np.column_stack([-away[:, 1], away[:, 0]])
    else:
        by_turn[:] = np.cross(np.eye(3), away[:, None, :]).transpose(0, 2, 1)
    result = np.zeros((n, kind.dof, d + by_turn.shape[2]))
    result[:, :d, :d], result[:, :d, d:] = np.eye(d), by_turn
    if kind is SE2:
        c, s = np.cos(values[:, 2]), np.sin(values[:, 2])
        R = np.stack([np.column_stack([c, -s]), np.column_stack([s, c])], axis=1)
        result[:, :d] = R.transpose(0, 2, 1) @ result[:, :d]
        result[:, d, d] = 1.0
    elif kind is SE3:
        R = matrices(np.ascontiguousarray(values[:, d:]))
        result[:, :d] = R.transpose(0, 2, 1) @ result[:, :d]
        result[:, d:, d:] = R.transpose(0, 2, 1)
    return result
