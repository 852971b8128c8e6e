"""The joint Gaussian of robot and features, which grows with the map.

    x = (x_v, y_1, y_2, ...)        P = [ P_xx    P_xy1   P_xy2  ... ]
                                        [ P_y1x   P_y1y1  P_y1y2 ... ]
                                        [ P_y2x   P_y2y1  P_y2y2 ... ]

All parts and blocks are views of two arrays, which `kernels` changes in place. Each block is kept
once: one above the diagonal is the transposed view of that below.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.ekf_slam import kernels

Array: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]

_FIRST_ROOM = 16


class JointGaussian:
    """Mean and covariance of the robot's state and of features of two numbers each.

    Parameters
    ----------
    x_v, P_xx
        The robot's state (nv,) and its covariance (nv, nv).
    """

    def __init__(self, x_v: Array, P_xx: Array) -> None:
        self.nv = len(x_v)
        self._count = 0
        self._x, self._P, self._W = x_v, P_xx.ravel(), np.empty((2, 4, 0))
        self._grow(_FIRST_ROOM)

    def __len__(self) -> int:
        """Return how many features there are."""
        return self._count

    @property
    def n(self) -> int:
        """Numbers of the state: nv + 2 features."""
        return self.nv + 2 * self._count

    @property
    def x(self) -> Array:
        """The mean (n,), a view."""
        return self._x[: self.n]

    @property
    def x_v(self) -> Array:
        """The robot's state (nv,), a view."""
        return self._x[: self.nv]

    @property
    def features(self) -> Array:
        """The features (k, 2), a view."""
        return self._x[self.nv : self.n].reshape(-1, 2)

    def covariance(self) -> Array:
        """Return a copy of the whole covariance (n, n); `block` gives views."""
        return kernels.dense(self._P, self._count, self.nv)

    def block(self, row: int | None, column: int | None) -> Array:
        """Return a block of the covariance as a view; None: the robot, else which feature.

        `block(None, None)` is P_xx, `block(None, 0)` P_xy1, `block(1, 0)` P_y2y1.

        Raises
        ------
        IndexError
            If there is no such feature.
        """
        for f in (row, column):
            if f is not None and not 0 <= f < self._count:
                raise IndexError(f"feature {f}: there are {self._count}")
        if row is None and column is None:
            return self._P[: self.nv**2].reshape(self.nv, self.nv)
        if row is None or (column is not None and column > row):
            return self.block(column, row).T
        start, length = kernels.panel_start(self.nv, row), self.nv + 2 * row + 2
        panel = self._P[start : start + 2 * length].reshape(2, length)
        if column is None:
            return panel[:, : self.nv]
        return panel[:, self.nv + 2 * column : self.nv + 2 * column + 2]

    def predict(self, x_v: Array, F: Array, Q: Array) -> None:
        """Move the robot to `x_v`; only its own rows and columns change.

        Parameters
        ----------
        F, Q
            Jacobian of the new robot state by the old one, and its noise, (nv, nv).
        """
        kernels.predict(self._P, self._count, self.nv, F, Q)
        self._x[: self.nv] = x_v

    def update(
        self,
        which: Indices,
        Hv: Array,
        Hf: Array,
        innovations: Array,
        R: Array,
        turns: NDArray[np.bool_],
    ) -> float:
        """Correct all by measurements of m features jointly; return their NIS, of dimension 2 m.

        Parameters
        ----------
        which
            The features, (m,).
        Hv, Hf
            Jacobians of the measurements by the robot (m, 2, nv) and by the feature (m, 2, 2).
        innovations, R
            Measured minus expected (m, 2), and noises of the measurements (m, 2, 2).
        turns
            Whether the errors of each feature and at last of the robot's position turn with that of
            the heading, (features + 1,); (0,): none.

        Raises
        ------
        ValueError
            If the innovations have no positive definite covariance; nothing has changed then.
        """
        if self._W.shape[1] < 2 * len(which) + 2:
            self._W = np.empty((2, 2 * len(which) + 2, len(self._x)))
        nis = kernels.update(
            self._x, self._P, self._count, self.nv, which, Hv, Hf, innovations, R, self._W, turns
        )
        if nis != nis:  # noqa: PLR0124 - nan
            raise ValueError("the covariance of the innovations is not positive definite")
        return nis

    def append(self, y: Array, Gv: Array, noise: Array) -> int:
        """Add a feature at the end; return its number.

        Parameters
        ----------
        y
            The feature (2,).
        Gv, noise
            Its Jacobian by the robot's state (2, nv), and its covariance given that, (2, 2).
        """
        if self.n + 2 > len(self._x):
            self._grow(2 * self._count)
        kernels.append(self._P, self._count, self.nv, Gv, noise)
        self._x[self.n : self.n + 2] = y
        self._count += 1
        return self._count - 1

    def remove(self, which: int) -> None:
        """Forget a feature: the others keep their joint distribution, and move up.

        Raises
        ------
        IndexError
            If there is no such feature.
        """
        self.block(which, which)
        kernels.remove(self._P, self._count, self.nv, which)
        features = self.features
        features[which:-1] = features[which + 1 :]
        self._count -= 1

    def innovation_covariances(self, which: Indices, Hv: Array, Hf: Array) -> Array:
        """Return H P H' of each of m measurements, without their noise, (m, 2, 2)."""
        each = np.arange(len(which))
        return kernels.innovation_covariance(self._P, self.nv, each, each, Hv, Hf, which)

    def joint_innovation_covariance(self, which: Indices, Hv: Array, Hf: Array) -> Array:
        """Return H P H' of m measurements together, without their noise, (2 m, 2 m)."""
        m = len(which)
        a, b = (each.ravel() for each in np.indices((m, m)))
        found = kernels.innovation_covariance(self._P, self.nv, a, b, Hv, Hf, which)
        return found.reshape(m, m, 2, 2).transpose(0, 2, 1, 3).reshape(2 * m, 2 * m)

    def _grow(self, features: int) -> None:
        """Make room for so many features; as the room doubles, it is seldom."""
        x, P = np.zeros(self.nv + 2 * features), np.zeros(kernels.panel_start(self.nv, features))
        x[: self.n] = self._x
        P[: len(self._P)] = self._P
        self._x, self._P, self._W = x, P, np.empty((2, self._W.shape[1], len(x)))
