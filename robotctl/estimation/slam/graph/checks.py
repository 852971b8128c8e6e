"""Checks of the arrays of a graph, before compiled loops see them.

A compiled loop reads whatever stands behind an array that is too short, and takes a number that is
not finite for a value. So graphs and problems look at their arrays once, when they are made.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind
from robotctl.estimation.slam.graph.variables import LARGEST, SE3, Floats, VariableKind

_UNIT: Final = 1e-6
"""How far the length of a unit quaternion may be from 1."""
_SYMMETRY: Final = 1e-6
"""Largest difference of mirrored entries, as a share of the largest entry."""


def check_block(block: FactorBlock, counts: Mapping[VariableKind, int]) -> None:
    """Refuse factors whose arrays do not fit their kind, or whose numbers cannot be values.

    Parameters
    ----------
    block
        The factors.
    counts
        How many variables there are of each kind.

    Raises
    ------
    ValueError
        With the kind, what was found, and what is needed.
    """
    kind, n = block.kind, len(block.measurements)
    if len(block.variables) != len(kind.variables):
        raise _wrong(kind, f"{len(block.variables)} variables found, {len(kind.variables)} needed")
    for variable, rows in zip(kind.variables, block.variables, strict=True):
        count = counts.get(variable, 0)
        if rows.shape != (n,) or rows.dtype != np.int64:
            raise _wrong(kind, f"variables {_shape(rows)} found, int64 ({n},) needed")
        if n and not (rows.min() >= 0 and rows.max() < count):
            raise _wrong(kind, f"variables {rows.min()} to {rows.max()} found, of kind "
                               f"{variable.name!r} there are {count}")  # fmt: skip
    for a, b in combinations(range(len(kind.variables)), 2):
        if kind.variables[a] is kind.variables[b]:
            loops = np.flatnonzero(block.variables[a] == block.variables[b])
            if len(loops):
                raise _wrong(kind, f"[{loops[0]}] links variable {block.variables[a][loops[0]]} of "
                                   f"kind {kind.variables[a].name!r} with itself")  # fmt: skip
    check_numbers(kind, block.measurements, block.information)


def check_numbers(kind: FactorKind, measurements: Floats, information: Floats) -> None:
    """Refuse measurements (n, measurement) or information (n, size, size) that cannot be.

    Raises
    ------
    ValueError
        With the kind, what was found, and what is needed.
    """
    n = len(measurements) if measurements.ndim else 0
    wanted = ((n, kind.measurement), (n, kind.size, kind.size))
    for name, array, shape in zip(
        ("measurements", "information"), (measurements, information), wanted, strict=True
    ):
        if array.shape != shape or array.dtype != np.float64:
            raise _wrong(kind, f"{name} {_shape(array)} found, float64 {shape} needed")
        if not is_sound(array):
            at = int(np.argmin(sound_rows(array)))
            raise _wrong(kind, f"{name}[{at}] has a number that is not finite or above {LARGEST:g}")
    if kind.quaternion is not None:
        _check_quaternions(measurements[:, kind.quaternion : kind.quaternion + 4], kind.name)
    mirrored = information.transpose(0, 2, 1)
    if not np.array_equal(information, mirrored):
        off = np.abs(information - mirrored).max(axis=(1, 2), initial=0.0)
        good = off <= _SYMMETRY * np.abs(information).max(axis=(1, 2), initial=0.0)
        if not np.all(good):
            raise _wrong(kind, f"information[{int(np.argmin(good))}] is not symmetric")


def check_values(
    counts: Mapping[VariableKind, int], values: Mapping[VariableKind, Floats], *, numbers: bool
) -> None:
    """Refuse values that do not belong to variables.

    Parameters
    ----------
    counts
        How many variables there are of each kind.
    values
        Of each kind, (n, size).
    numbers
        Whether to look at the numbers, too.

    Raises
    ------
    ValueError
        With the kind, what was found, and what is needed.
    """
    for kind, count in counts.items():
        if kind not in values:
            raise ValueError(f"values: none found of the kind {kind.name!r}, {count} needed")
        own = values[kind]
        if own.shape != (count, kind.size) or own.dtype != np.float64:
            raise ValueError(f"values of {kind.name!r}: {_shape(own)} found, float64 "
                             f"{(count, kind.size)} needed")  # fmt: skip
        if numbers:
            if not is_sound(own):
                at = int(np.argmin(sound_rows(own)))
                raise ValueError(f"values of {kind.name!r}: row {at} has a number that is not "
                                 f"finite or above {LARGEST:g}")  # fmt: skip
            if kind is SE3:
                _check_quaternions(own[:, 3:], f"values of {kind.name!r}")


def is_sound(array: Floats) -> bool:
    """Return whether all numbers are finite, and small enough to be multiplied."""
    # A nan compares as false.
    return array.size == 0 or bool(array.max() <= LARGEST and array.min() >= -LARGEST)


def sound_rows(array: Floats) -> NDArray[np.bool_]:
    """Return in which rows all numbers are, (n,)."""
    result: NDArray[np.bool_] = np.all(np.abs(array.reshape(len(array), -1)) <= LARGEST, axis=1)
    return result


def _check_quaternions(quaternions: Floats, name: str) -> None:
    """Refuse quaternions (n, 4) that are not of length 1."""
    good = np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) <= _UNIT
    if not np.all(good):
        at = int(np.argmin(good))
        raise ValueError(f"{name}: row {at} has no unit quaternion: {quaternions[at].tolist()}")


def _wrong(kind: FactorKind, problem: str) -> ValueError:
    return ValueError(f"factors {kind.name!r}: {problem}")


def _shape(array: NDArray[Any]) -> str:
    return f"{array.dtype} {array.shape}"
