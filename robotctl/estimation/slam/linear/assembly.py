"""The matrix J^T Omega J of least squares, added up where its Cholesky factor will stand.

One compiled loop for each size of residuals and increments: with constant bounds the compiler
unrolls it. A loop stands whole: numba keeps no compiled code of functions that close over others.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@cache
def pair_assembler(  # noqa: C901 - one compiled loop
    size: int, dof_a: int, dof_b: int
) -> Callable[..., None]:
    """Return the loop for factors of two variables."""

    @compiled
    def assemble(  # noqa: C901 - one compiled loop
        residuals: Floats, by_a: Floats, by_b: Floats, information: Floats, weights: Floats,
        places: Ints, columns: Ints, panels: Floats, gradient: Floats,
    ) -> None:  # fmt: skip
        """Add factors (n,); of `places` (n, 7) and `columns` (n, 2), -1 is a fixed variable."""
        left, right = np.empty((size, dof_a)), np.empty((size, dof_b))
        for k in range(len(weights)):
            for i in range(size):
                for j in range(dof_a):
                    total = 0.0
                    for m in range(size):
                        total += information[k, i, m] * by_a[k, m, j]
                    left[i, j] = weights[k] * total
                for j in range(dof_b):
                    total = 0.0
                    for m in range(size):
                        total += information[k, i, m] * by_b[k, m, j]
                    right[i, j] = weights[k] * total
            at, stride = places[k, 0], places[k, 1]
            if at >= 0:
                for j in range(dof_a):
                    total = 0.0
                    for m in range(size):
                        total += left[m, j] * residuals[k, m]
                    gradient[columns[k, 0] + j] += total
                    for i in range(dof_a):
                        total = 0.0
                        for m in range(size):
                            total += by_a[k, m, i] * left[m, j]
                        panels[at + j * stride + i] += total
            at, stride = places[k, 2], places[k, 3]
            if at >= 0:
                for j in range(dof_b):
                    total = 0.0
                    for m in range(size):
                        total += right[m, j] * residuals[k, m]
                    gradient[columns[k, 1] + j] += total
                    for i in range(dof_b):
                        total = 0.0
                        for m in range(size):
                            total += by_b[k, m, i] * right[m, j]
                        panels[at + j * stride + i] += total
            at, stride = places[k, 4], places[k, 5]
            if at >= 0 and places[k, 6] == 0:  # b is eliminated after a: its rows
                for j in range(dof_a):
                    for i in range(dof_b):
                        total = 0.0
                        for m in range(size):
                            total += by_b[k, m, i] * left[m, j]
                        panels[at + j * stride + i] += total
            elif at >= 0:
                for j in range(dof_b):
                    for i in range(dof_a):
                        total = 0.0
                        for m in range(size):
                            total += by_a[k, m, i] * right[m, j]
                        panels[at + j * stride + i] += total

    return assemble


@cache
def single_assembler(size: int, dof: int) -> Callable[..., None]:  # noqa: C901 - one compiled loop
    """Return the loop for factors of one variable."""

    @compiled
    def assemble(
        residuals: Floats, by_a: Floats, information: Floats, weights: Floats,
        places: Ints, columns: Ints, panels: Floats, gradient: Floats,
    ) -> None:  # fmt: skip
        """Add factors (n,), as the loop for two."""
        left = np.empty((size, dof))
        for k in range(len(weights)):
            at, stride = places[k, 0], places[k, 1]
            if at < 0:
                continue
            for i in range(size):
                for j in range(dof):
                    total = 0.0
                    for m in range(size):
                        total += information[k, i, m] * by_a[k, m, j]
                    left[i, j] = weights[k] * total
            for j in range(dof):
                total = 0.0
                for m in range(size):
                    total += left[m, j] * residuals[k, m]
                gradient[columns[k, 0] + j] += total
                for i in range(dof):
                    total = 0.0
                    for m in range(size):
                        total += by_a[k, m, i] * left[m, j]
                    panels[at + j * stride + i] += total

    return assemble


@compiled
def assemble_many(  # noqa: C901 - one compiled loop
    residuals: Floats, jacobians: Floats, begins: Ints, information: Floats, weights: Floats,
    places: Ints, columns: Ints, panels: Floats, gradient: Floats,
) -> None:  # fmt: skip
    """Add factors (n,) of any number of variables, as the loops for two and one.

    Parameters
    ----------
    jacobians, begins
        Those of all variables beside each other, (n, size, width), and where each begins.
    places
        For each pair a <= b of variables three numbers: place, stride, and whether a comes later.
    """
    n, size, width = jacobians.shape
    weighted = np.empty((size, width))
    for k in range(n):
        for i in range(size):
            for j in range(width):
                total = 0.0
                for m in range(size):
                    total += information[k, i, m] * jacobians[k, m, j]
                weighted[i, j] = weights[k] * total
        at = 0
        for a in range(len(begins) - 1):
            if columns[k, a] >= 0:
                for i in range(begins[a], begins[a + 1]):
                    for m in range(size):
                        gradient[columns[k, a] + i - begins[a]] += weighted[m, i] * residuals[k, m]
            for b in range(a, len(begins) - 1):
                place, stride, is_later = places[k, at], places[k, at + 1], places[k, at + 2]
                at += 3
                if place < 0:
                    continue
                for i in range(begins[a + 1] - begins[a]):
                    for j in range(begins[b + 1] - begins[b]):
                        total = 0.0
                        for m in range(size):
                            total += jacobians[k, m, begins[a] + i] * weighted[m, begins[b] + j]
                        if is_later:
                            panels[place + j * stride + i] += total
                        else:
                            panels[place + i * stride + j] += total


@compiled
def quadratic_forms(residuals: Floats, information: Floats) -> Floats:
    """Return r^T Omega r of each residual, (n,); at least 0, whatever is rounded."""
    n, size = residuals.shape
    result = np.zeros(n)
    for k in range(n):
        for i in range(size):
            row = 0.0
            for j in range(size):
                row += information[k, i, j] * residuals[k, j]
            result[k] += residuals[k, i] * row
        result[k] = max(result[k], 0.0)
    return result


def inner(a: Floats, b: Floats) -> float:
    """Return the sum of a b, of any shape. BLAS would wake its threads for it, each time."""
    return float(np.sum(a * b))
