"""Place of a part of a graph in the plane, by bearings, ranges and positions of known points.

These have many local minima, so a grid of poses of the whole part descends at once, and the best of
them counts (Levenberg and Marquardt on three numbers each).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotctl.estimation.slam.graph.factor import FactorBlock, Linearised
from robotctl.estimation.slam.graph.variables import SE2, Floats
from robotctl.estimation.slam.linear.assembly import quadratic_forms
from robotctl.estimation.slam.start.twists import twist_increments

_HEADINGS: Final = 16
_RINGS: Final = (0.0, 1.0, 3.0)
"""Distances of candidates from the middle of what is known, as multiples of its spread."""
_STEPS: Final = 30
_FIRST_DAMPING: Final = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """Factors of one kind between poses of a part and what is known.

    Parameters
    ----------
    block
        The factors, (n,).
    poses
        The pose of each, (n, 3).
    known
        The point of each, (n, 2); None where the measurement says what is known.
    """

    block: FactorBlock
    poses: Floats
    known: Floats | None

    @property
    def numbers(self) -> int:
        """How many numbers are measured."""
        return len(self.block) * self.block.kind.size

    @property
    def places(self) -> Floats:
        """Positions of what is known, (n, 2)."""
        return self.block.measurements if self.known is None else self.known


def best_pose(outlooks: Sequence[Outlook]) -> tuple[Floats, Floats]:
    """Return the rotation (2, 2) and shift (2,) that move a part to where it fits best."""
    middle = np.concatenate([each.poses[:, :2] for each in outlooks]).mean(axis=0)
    frames = _candidates(np.concatenate([each.places for each in outlooks]))
    damping = np.full(len(frames), _FIRST_DAMPING)
    cost, H, g = _equations(outlooks, middle, frames)
    for _ in range(_STEPS):
        diagonal = np.einsum("bii->bi", H) + 1e-12
        damped = H + (damping[:, None] * diagonal)[:, :, None] * np.eye(3)
        there = frames - np.linalg.solve(damped, g[:, :, None])[:, :, 0]
        after, H_there, g_there = _equations(outlooks, middle, there)
        better = after < cost
        frames[better], cost[better] = there[better], after[better]
        H[better], g[better] = H_there[better], g_there[better]
        damping *= np.where(better, 0.2, 5.0)
    x, y, turn = frames[np.argmin(cost)]
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s], [s, c]])
    return R, np.array([x, y]) - R @ middle


def _candidates(places: Floats) -> Floats:
    """Return x, y of the middle of a part, and its turn, (b, 3), around known places (n, 2)."""
    centre = places.mean(axis=0)
    spread = max(float(np.sqrt(np.mean(np.sum((places - centre) ** 2, axis=1)))), 1.0)
    angles = np.arange(_HEADINGS) * (2.0 * np.pi / _HEADINGS)
    around = np.column_stack([np.cos(angles), np.sin(angles)])[::4]
    shifts = np.concatenate([spread * ring * around for ring in _RINGS])
    grid = np.repeat(np.unique(shifts, axis=0), _HEADINGS, axis=0) + centre
    return np.column_stack([grid, np.tile(angles, len(grid) // _HEADINGS)])


def _equations(
    outlooks: Sequence[Outlook], middle: Floats, frames: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return chi2 (b,), matrices (b, 3, 3) and gradients (b, 3) of a part in each of b places."""
    count = len(frames)
    cost, H, g = np.zeros(count), np.zeros((count, 3, 3)), np.zeros((count, 3))
    c, s = np.cos(frames[:, 2]), np.sin(frames[:, 2])
    R = np.stack([np.column_stack([c, -s]), np.column_stack([s, c])], axis=1)
    for each in outlooks:
        n = len(each.block)
        block = each.block.take(np.tile(np.arange(n), count))
        away = np.einsum("bij,nj->bni", R, each.poses[:, :2] - middle) + frames[:, None, :2]
        headings = each.poses[:, 2] + frames[:, 2:]
        poses = np.concatenate([away, headings[:, :, None]], axis=2).reshape(-1, 3)
        at = Linearised.empty(block)
        rest = () if each.known is None else (np.tile(each.known, (count, 1)),)
        at.fill(block, (poses, *rest))
        J = at.jacobians[0] @ twist_increments(SE2, poses, np.repeat(frames[:, :2], n, axis=0))
        weighted = block.information @ J
        H += (J.transpose(0, 2, 1) @ weighted).reshape(count, n, 3, 3).sum(axis=1)
        g += np.einsum("fij,fi->fj", weighted, at.residuals).reshape(count, n, 3).sum(axis=1)
        cost += quadratic_forms(at.residuals, block.information).reshape(count, n).sum(axis=1)
    return cost, H, g
