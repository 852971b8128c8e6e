"""Places of variables that move with a pose."""

from __future__ import annotations

import numpy as np

from robotctl.estimation.slam.graph.variables import SE2, SE3, Floats, VariableKind
from robotctl.estimation.slam.start.chordal import matrices
from robotctl.estimation.slam.start.spanning import compose_3d


def carried(
    kind: VariableKind, value: Floats, anchor: VariableKind, before: Floats, now: Floats
) -> Floats:
    """Return a value (size,) as seen from a pose `before`, at where that pose is `now`.

    A value of the plane does not move with a pose in space, nor the other way round.
    """
    if kind.positions != anchor.positions:
        return value
    if anchor is SE2:
        turn = now[2] - before[2]
        c, s = np.cos(turn), np.sin(turn)
        dx, dy = value[:2] - before[:2]
        result = value.copy()
        result[:2] = now[0] + c * dx - s * dy, now[1] + s * dx + c * dy
        if kind is SE2:
            result[2] += turn
        return result
    R = matrices(before[None, 3:])[0].T
    local = np.zeros(7)
    local[6] = 1.0
    local[:3] = R @ (value[:3] - before[:3])
    if kind is SE3:
        inverse = before * np.array([0.0, 0.0, 0.0, -1.0, -1.0, -1.0, 1.0])
        inverse[:3] = 0.0
        turned = np.empty(7)
        compose_3d(inverse, np.concatenate([np.zeros(3), value[3:]]), 0, turned)
        local[3:] = turned[3:]
    placed = np.empty(7)
    compose_3d(now, local, 0, placed)
    return placed[: kind.size]
