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

from robotctl.estimation.kalman.growing_gaussian import HEADING as HEADING_COLUMN
from robotctl.estimation.kalman.growing_gaussian import GrowingGaussian
from robotctl.estimation.slam.ekf_slam.features import HEADING
from robotctl.estimation.slam.ekf_slam.filter import PAST_POSE, EkfSlam
from robotctl.model.geometry.angles import wrap_angle
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
        self.belief = GrowingGaussian(np.zeros(_POSE), np.zeros((_POSE, _POSE)))
        """The pose x [m], y [m], theta [rad] in `world`, then two numbers a feature."""
        self.names: list[int | str] = []
        """Names of the features."""
        self._turns: list[bool] = []
        self._index: dict[int | str, int] = {}

    @property
    def base(self) -> SE2:
        """Origin of the present local map, in `world`."""
        x, y, theta = self.belief.x[:_POSE].tolist()
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
        self.belief.remove(0, _POSE)  # the pose behind the features begins the next map
        for _, second in reversed(twice):
            self._drop(second)
        self._index = {name: number for number, name in enumerate(self.names)}
        return self.begin()

    def feature(self, name: int | str) -> tuple[Array, Array]:
        """Return the two numbers of a feature, and their covariance (2, 2)."""
        at = self._column(name) + np.arange(2)
        return self.belief.x[at], self.belief.block(at)

    def past(self, name: int | str) -> tuple[SE2, Array]:
        """Return a pose that a local map remembered, and its covariance (3, 3)."""
        place, heading = (self._column(f"{what} {name}") for what in PAST_POSE)
        at = np.array([place, place + 1, heading])
        x, y, theta = self.belief.x[at].tolist()
        return SE2(x, y, wrap_angle(theta)), self.belief.block(at)

    def _column(self, name: int | str) -> int:
        """Return the first column of a feature."""
        return _POSE + 2 * self._index[name]

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
        moved, own, by_base = (
            np.roll(moved, -_POSE), np.roll(own, -_POSE, (0, 1)), np.roll(by_base, -_POSE, 0)
        )  # fmt: skip
        self.belief.append(moved, np.arange(_POSE), by_base, own)
        self.names += local.names
        self._turns += turns.tolist()

    def _unite(self, twice: NDArray[np.int64]) -> None:
        """Take in that pairs of features (m, 2) are the same."""
        first, second = (_POSE + 2 * twice[:, k, None] + [0, 1] for k in (0, 1))
        off = self.belief.x[second] - self.belief.x[first]
        columns = np.concatenate([first, second, np.full((len(twice), 1), HEADING_COLUMN)], axis=1)
        J = np.zeros((len(twice), 2, 5))
        J[:, 0, 0] = J[:, 1, 1] = 1.0
        J[:, 0, 2] = J[:, 1, 3] = -1.0
        # Errors turn with the heading of the base, those of both places about the origin.
        J[:, 0, 4], J[:, 1, 4] = -off[:, 1], off[:, 0]
        places = _POSE + 2 * np.flatnonzero(self._turns)
        end = self.belief.n - _POSE
        noise = np.tile(_NOISE_M2 * np.eye(2), (len(twice), 1, 1))
        self.belief.update(columns, J, off, noise, np.array([0, *places, end], np.int64))

    def _drop(self, number: int) -> None:
        """Take out a feature; the last one takes its number."""
        self.belief.remove(_POSE + 2 * number, 2)
        self.names[number], self._turns[number] = self.names[-1], self._turns[-1]
        self.names.pop()
        self._turns.pop()
