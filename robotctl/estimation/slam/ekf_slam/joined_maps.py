"""Lots of little local maps, joined: what an update costs does not grow with the world.

    maps = JoinedMaps()
    local = maps.begin()                                         # an EkfSlam at its own origin
    local.move(...), local.sight(...)
    if maps.is_full(local):
        local = maps.join(local)                                 # the next one

A local map begins where the robot is, without doubt, and uses no measurement of another one, so
local maps are independent until they are joined (Tardós, Neira, Newman, Leonard: Robust mapping and
localization in indoor environments using sonar data, IJRR 21(4), 2002). Joining puts a local map
behind the pose at which it began. Features that were known before are there twice then; that both
are the same is a measurement without noise. As in `EkfSlam` errors turn with the heading, here of
the pose at which the local map began: the innovation does not depend on how far the two places are
apart, the correction moves positions along the exponential of SE(2), and the covariance follows.
A turn of the whole stays unobservable.

A join costs what one update of a filter of all features costs, a few times. In between, an update
costs what the local map is worth; loops close when their map is joined. Association is by names.
"""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.ekf_slam.features import HEADING
from robotctl.estimation.slam.ekf_slam.filter import EkfSlam
from robotctl.model.geometry.angles import sinc, wrap_angle
from robotctl.model.geometry.points import rotation
from robotctl.model.geometry.se2 import SE2

Array: TypeAlias = NDArray[np.float64]

MOST_FEATURES: Final = 30
"""Maximum features of a local map."""
_POSE: Final = 3
_NOISE_M2: Final = 1e-12


class JoinedMaps:
    """The pose at which the present local map begins, and all features of maps before.

    Parameters
    ----------
    most_features
        At which a local map is full.
    """

    def __init__(self, most_features: int = MOST_FEATURES) -> None:
        self.most_features = most_features
        self.x = np.zeros(_POSE)
        """The pose x [m], y [m], theta [rad] in `world`, then two numbers a feature, (n,)."""
        self.P = np.zeros((_POSE, _POSE))
        """Its covariance (n, n)."""
        self.names: list[int | str] = []
        """Names of the features."""
        self._turns = np.empty(0, np.bool_)
        self._index: dict[int | str, int] = {}

    @property
    def base(self) -> SE2:
        """Origin of the present local map, in `world`."""
        x, y, theta = self.x[:_POSE].tolist()
        return SE2(x, y, wrap_angle(theta))

    def begin(self) -> EkfSlam:
        """Return an empty local map."""
        return EkfSlam(np.zeros(_POSE), np.zeros((_POSE, _POSE)))

    def is_full(self, local: EkfSlam) -> bool:
        """Return whether a local map should be joined."""
        return len(local.names) >= self.most_features

    def join(self, local: EkfSlam) -> EkfSlam:
        """Take in a local map; return the next one, which begins where it ends."""
        first = len(self.names)
        self._append(local)
        twice = [
            (known, first + k)
            for k, name in enumerate(local.names)
            if (known := self._index.get(name)) is not None
        ]
        if twice:
            self._unite(np.array(twice))
        self._move_base()
        for k, name in enumerate(local.names):
            self._index.setdefault(name, first + k)
        if twice:
            self._drop({second for _, second in twice})
        return self.begin()

    def feature(self, name: int | str) -> tuple[Array, Array]:
        """Return the two numbers of a feature, and their covariance (2, 2)."""
        at = _POSE + 2 * self._index[name]
        return self.x[at : at + 2], self.P[at : at + 2, at : at + 2]

    def past(self, name: int | str) -> tuple[SE2, Array]:
        """Return a pose that a local map remembered, and its covariance (3, 3)."""
        place, heading = (
            _POSE + 2 * self._index[f"{what} {name}"] for what in ("place", "heading")
        )
        at = [place, place + 1, heading]
        x, y, theta = self.x[at].tolist()
        return SE2(x, y, wrap_angle(theta)), self.P[np.ix_(at, at)]

    def _append(self, local: EkfSlam) -> None:
        """Put the features of a local map behind all others, and at last the pose where it ends."""
        base, belief = self.base, local.belief
        R = rotation(-base.theta_rad)
        turns = np.array([kind is not HEADING for kind in local.kinds], np.bool_)
        moved = belief.x.copy()
        by_base, by_local = np.zeros((belief.n, _POSE)), np.eye(belief.n)
        moved[2] += base.theta_rad
        by_base[2, 2] = 1.0
        places = np.flatnonzero(np.concatenate([[True], turns]))
        at = np.where(places == 0, 0, _POSE + 2 * (places - 1))
        turned = belief.x[np.stack([at, at + 1], axis=1)] @ R.T
        for k, row in enumerate(at.tolist()):
            moved[row : row + 2] = turned[k] + [base.x_m, base.y_m]
            by_base[row : row + 2] = [[1.0, 0.0, -turned[k, 1]], [0.0, 1.0, turned[k, 0]]]
            by_local[row : row + 2, row : row + 2] = R
        headings = _POSE + 2 * np.flatnonzero(~turns)
        moved[headings] += base.theta_rad
        by_base[headings, 2] = 1.0
        own = by_local @ belief.covariance() @ by_local.T
        own += by_base @ self.P[:_POSE, :_POSE] @ by_base.T
        across = by_base @ self.P[:_POSE]
        own, across = np.roll(own, -_POSE, (0, 1)), np.roll(across, -_POSE, 0)
        self.P = np.block([[self.P, across.T], [across, own]])
        self.x = np.concatenate([self.x, np.roll(moved, -_POSE)])
        self.names += local.names
        self._turns = np.concatenate([self._turns, turns])

    def _move_base(self) -> None:
        """Begin the next local map at the pose that is behind all features."""
        end = len(self.x) - _POSE
        order = np.concatenate([np.arange(end, end + _POSE), np.arange(_POSE, end)])
        self.x, self.P = self.x[order], self.P[np.ix_(order, order)]

    def _unite(self, twice: NDArray[np.int64]) -> None:
        """Take in that pairs of features (m, 2) are the same."""
        first, second = (_POSE + 2 * twice[:, k, None] + [0, 1] for k in (0, 1))
        a, b = first.ravel(), second.ravel()
        off = self.x[b] - self.x[a]
        # Errors turn with the heading of the base, those of both places about the origin.
        turned = np.stack([-off[1::2], off[::2]], axis=1).ravel()
        HP = self.P[a] - self.P[b] + np.outer(turned, self.P[2])
        S = HP[:, a] - HP[:, b] + np.outer(HP[:, 2], turned)
        L = np.linalg.cholesky(S + _NOISE_M2 * np.eye(len(S)))
        W = np.linalg.solve(L, HP)
        self.P -= W.T @ W
        self._correct(W.T @ np.linalg.solve(L, off))

    def _correct(self, change: Array) -> None:
        """Correct the state along the exponential of SE(2), and let the covariance follow."""
        places = _POSE + 2 * np.flatnonzero(self._turns)
        at = np.concatenate([[0], places, [len(self.x) - _POSE]])
        rows = np.stack([at, at + 1], axis=1)
        change[rows] = change[rows] @ _along(float(change[2])).T
        self.x += change
        u = np.zeros(len(self.x))
        u[at], u[at + 1] = -change[at + 1], change[at]
        v = self.P[2] + 0.5 * self.P[2, 2] * u
        self.P += np.outer(u, v) + np.outer(v, u)

    def _drop(self, numbers: set[int]) -> None:
        """Take out features."""
        kept = [k for k in range(len(self.names)) if k not in numbers]
        at = np.concatenate(
            [np.arange(_POSE), (_POSE + 2 * np.array(kept)[:, None] + [0, 1]).ravel()]
        )
        self.x, self.P = self.x[at], self.P[np.ix_(at, at)]
        self.names = [self.names[k] for k in kept]
        self._turns = self._turns[kept]
        self._index = {name: k for k, name in enumerate(self.names)}


def _along(turn_rad: float) -> Array:
    """Return V (2, 2) of SE(2): a motion V dp goes with dp along a turn of this angle."""
    half = 0.5 * turn_rad
    result: Array = sinc(half) * rotation(-half)
    return result
