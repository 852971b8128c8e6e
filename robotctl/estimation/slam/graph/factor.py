"""Kinds of factors, and blocks of many factors of one kind.

A factor says how well its variables fit a measurement: r^T Omega r with the residual r and the
information matrix Omega, the inverse of the covariance of r. The sum of all is chi2, without the
factor one half, as g2o reports it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import Floats, VariableKind

Ints: TypeAlias = NDArray[np.int64]
_STEP: Final = 1e-6
ROUNDING: Final = 1e-9
"""Eigenvalues below that are nothing but rounded digits, where the diagonal is 1."""


@dataclass(frozen=True, slots=True, eq=False)
class FactorKind:
    """One kind of factors: a residual function, and perhaps its Jacobians.

    Parameters
    ----------
    name
        For messages.
    variables
        Kinds of the variables of a factor, one or more.
    measurement
        Numbers of one measurement.
    size
        Of one residual.
    residual
        Maps the values of each variable, (n, size of its kind), and measurements (n, measurement)
        to residuals (n, size). Angles in it are wrapped.
    linearise
        Takes the same, then arrays that it fills: residuals (n, size) and, for each variable, their
        derivatives by its increment (n, size, dof). None: differences of `residual`.
    quaternion
        Place in a measurement where a unit quaternion begins; None: it holds none.
    """

    name: str
    variables: tuple[VariableKind, ...]
    measurement: int
    size: int
    residual: Callable[..., Floats]
    linearise: Callable[..., None] | None = None
    quaternion: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FactorBlock:
    """Factors of one kind, as arrays.

    Parameters
    ----------
    kind
        Of all of them.
    variables
        For each variable of the kind, its row among the values of its kind, (n,).
    measurements
        (n, measurement).
    information
        Inverse covariances of the residuals, (n, size, size), symmetric, positive semidefinite: of
        what a zero eigenvalue stands for, the factor says nothing.
    kernel
        Robust kernel of these factors, whatever others have; None: that of the problem, if any.
    """

    kind: FactorKind
    variables: tuple[Ints, ...]
    measurements: Floats
    information: Floats
    kernel: RobustKernel | None = None

    def __len__(self) -> int:
        return len(self.measurements)

    def take(self, chosen: NDArray[Any]) -> FactorBlock:
        """Return some of the factors: a mask or indices, (m,)."""
        return FactorBlock(
            self.kind,
            tuple(each[chosen] for each in self.variables),
            self.measurements[chosen],
            self.information[chosen],
            self.kernel,
        )

    def informed(self) -> FactorBlock:
        """Return the factors with any information."""
        says_something = np.any(self.information, axis=(1, 2))
        return self if np.all(says_something) else self.take(says_something)


@dataclass(slots=True, eq=False)
class Linearised:
    """A block of factors about values of its variables.

    Parameters
    ----------
    residuals
        (n, size).
    jacobians
        For each variable, (n, size, dof).
    """

    residuals: Floats
    jacobians: tuple[Floats, ...]

    @staticmethod
    def empty(block: FactorBlock) -> Linearised:
        """Return space for a block."""
        n, size = len(block), block.kind.size
        return Linearised(
            np.empty((n, size)),
            tuple(np.empty((n, size, each.dof)) for each in block.kind.variables),
        )

    @staticmethod
    def of_one(kind: FactorKind, values: tuple[Floats, ...], measurement: Floats) -> Linearised:
        """Return one factor about the values of its variables, each (size of its kind,)."""
        none = np.empty((1, kind.size, kind.size))
        block = FactorBlock(kind, (), measurement[np.newaxis], none)
        result = Linearised.empty(block)
        result.fill(block, tuple(each[np.newaxis] for each in values))
        return result

    def fill(self, block: FactorBlock, values: tuple[Floats, ...]) -> None:
        """Linearise a block about the values of its variables, each (n, size of its kind)."""
        kind = block.kind
        if kind.linearise is not None:
            kind.linearise(*values, block.measurements, self.residuals, *self.jacobians)
            return
        self.residuals[:] = kind.residual(*values, block.measurements)
        numerical_jacobians(block, values, self.jacobians)


def numerical_jacobians(
    block: FactorBlock, values: tuple[Floats, ...], jacobians: tuple[Floats, ...]
) -> None:
    """Fill Jacobians with central differences of the residual function."""
    kind = block.kind
    for slot, (variable, jacobian) in enumerate(zip(kind.variables, jacobians, strict=True)):
        for column in range(variable.dof):
            step = np.zeros((len(block), variable.dof))
            ends = []
            for sign in (1.0, -1.0):
                step[:, column] = sign * _STEP
                moved = list(values)
                moved[slot] = variable.retract(values[slot], step)
                ends.append(kind.residual(*moved, block.measurements))
            jacobian[:, :, column] = (ends[0] - ends[1]) / (2.0 * _STEP)


def scaled(matrices: Floats) -> tuple[Floats, Floats]:
    """Return matrices (n, size, size) with a diagonal of ones, and the roots of what it was.

    Metres and radians are alike then. A zero on the diagonal stays one.
    """
    roots = np.sqrt(np.abs(np.diagonal(matrices, axis1=1, axis2=2)))
    roots = np.where(roots > 0.0, roots, 1.0)
    return matrices / (roots[:, :, None] * roots[:, None, :]), roots


def is_definite(matrices: Floats) -> NDArray[np.bool_]:
    """Return which symmetric matrices (n, size, size) are positive definite beyond rounding."""
    try:
        # One Cholesky factor each is a tenth of the work of eigenvalues.
        factors = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        good: NDArray[np.bool_] = np.linalg.eigvalsh(scaled(matrices)[0])[:, 0] > ROUNDING
    else:
        pivots = np.diagonal(factors, axis1=1, axis2=2) ** 2
        good = np.all(pivots > ROUNDING * np.diagonal(matrices, axis1=1, axis2=2), axis=1)
    return good


def is_semidefinite(matrices: Floats) -> NDArray[np.bool_]:
    """Return which symmetric matrices (n, size, size) are positive semidefinite up to rounding."""
    good = is_definite(matrices)
    if not np.all(good):
        good[~good] = np.linalg.eigvalsh(scaled(matrices[~good])[0])[:, 0] >= -ROUNDING
    return good


def clipped(matrices: Floats) -> Floats:
    """Return symmetric matrices (n, size, size) with 0 in place of negative eigenvalues.

    Of the scaled matrices these are the nearest positive semidefinite ones (Higham 1988).
    """
    own, roots = scaled(matrices)
    values, vectors = np.linalg.eigh(own)
    nearest = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.transpose(0, 2, 1)
    nearest = 0.5 * (nearest + nearest.transpose(0, 2, 1))
    result: Floats = nearest * (roots[:, :, None] * roots[:, None, :])
    return result


def inverses(matrices: Floats) -> Floats:
    """Return the inverse of each matrix (n, size, size): informations of covariances, or back."""
    return np.linalg.inv(matrices).astype(np.float64)
