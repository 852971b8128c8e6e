"""Putting a graph together, arrays of variables and factors at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.checks import check_numbers, check_values
from robotctl.estimation.slam.graph.factor import FactorBlock, FactorKind, Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.robust_kernel import RobustKernel
from robotctl.estimation.slam.graph.variables import KINDS, Floats, VariableKind


class GraphBuilder:
    """Collects variables and factors; variables that only factors name are made with them."""

    def __init__(self) -> None:
        self._variables: dict[VariableKind, list[tuple[Ints, Floats]]] = {}
        self._factors: dict[
            tuple[FactorKind, RobustKernel | None], list[tuple[Ints, Floats, Floats]]
        ] = {}

    def variables(self, kind: VariableKind, ids: Ints, values: Floats) -> None:
        """Add variables (n,) with their values (n, size); a later value replaces an earlier.

        Raises
        ------
        ValueError
            If the arrays have other shapes, or a number cannot be a value.
        """
        ids, values = _numbers_of(ids, (-1,)), np.asarray(values, np.float64)
        check_values({kind: len(ids)}, {kind: values}, numbers=True)
        self._variables.setdefault(kind, []).append((ids, values))

    def factors(
        self, kind: FactorKind, ids: Ints, measurements: Floats, information: Floats,
        kernel: RobustKernel | None = None,
    ) -> None:  # fmt: skip
        """Add factors on the variables `ids` (n, variables); arrays and kernel: `FactorBlock`.

        Raises
        ------
        ValueError
            If the arrays have other shapes, or a number cannot be a measurement or information.
        """
        ids = _numbers_of(ids, (len(measurements), len(kind.variables)))
        measurements = np.asarray(measurements, np.float64)
        information = np.asarray(information, np.float64)
        check_numbers(kind, measurements, information)
        self._factors.setdefault((kind, kernel), []).append((ids, measurements, information))

    def build(self) -> tuple[FactorGraph, Values, dict[VariableKind, NDArray[np.bool_]]]:
        """Return the graph, values, and of each kind which of them were given, (n,)."""
        ids: dict[VariableKind, Ints] = {}
        values: Values = {}
        known = {}
        own_kinds = [kind for factor, _ in self._factors for kind in factor.variables]
        for kind in dict.fromkeys([*KINDS, *self._variables, *own_kinds]):
            named = [own for own, _ in self._variables.get(kind, ())]
            for (factor, _), parts in self._factors.items():
                for slot, variable in enumerate(factor.variables):
                    if variable is kind:
                        named += [part[0][:, slot] for part in parts]
            if not named:
                continue
            ids[kind] = np.unique(np.concatenate(named))
            values[kind] = np.tile(np.array(kind.identity), (len(ids[kind]), 1))
            known[kind] = np.zeros(len(ids[kind]), np.bool_)
            for own, given in self._variables.get(kind, ()):
                rows = np.searchsorted(ids[kind], own)
                values[kind][rows], known[kind][rows] = given, True
        blocks = []
        for (factor, kernel), parts in self._factors.items():
            named = [np.concatenate([part[0][:, slot] for part in parts]) for slot in range(len(factor.variables))]  # fmt: skip # noqa: E501
            rows_of = tuple(
                np.searchsorted(ids[kind], own).astype(np.int64)
                for kind, own in zip(factor.variables, named, strict=True)
            )
            blocks.append(
                FactorBlock(
                    factor,
                    rows_of,
                    np.ascontiguousarray(np.concatenate([part[1] for part in parts])),
                    np.ascontiguousarray(np.concatenate([part[2] for part in parts])),
                    kernel,
                )
            )
        return FactorGraph(ids, tuple(blocks)), values, known


def _numbers_of(ids: Ints, shape: tuple[int, ...]) -> Ints:
    """Return ids as int64, once they are whole numbers of a shape; -1 stands for any length."""
    ids = np.asarray(ids)
    fits = ids.ndim == len(shape) and all(
        wanted in (-1, found) for wanted, found in zip(shape, ids.shape, strict=True)
    )
    if not fits or not (np.issubdtype(ids.dtype, np.integer) or ids.size == 0):
        raise ValueError(f"ids {ids.dtype} {ids.shape} found, whole numbers {shape} needed")
    return ids.astype(np.int64)
