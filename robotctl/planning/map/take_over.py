"""Taking over into a live map what another map knows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from robotctl.model.grid_map import OCCUPIED
from robotctl.planning.map.marks import Cells, Layer


def take_over(
    cells: Cells, layers: Sequence[Layer], old: Cells, old_layers: Sequence[Layer], at: list[int]
) -> None:
    """Take what is marked and known to be free.

    Parameters
    ----------
    cells, layers
        Changed in place. They have seen nothing yet.
    old, old_layers
        What has been seen.
    at
        Row and column of the old map's first cell; all of it must lie on the new one.
    """
    rows, columns = old.live.shape
    part = slice(at[0], at[0] + rows), slice(at[1], at[1] + columns)
    base = cells.base[part]  # a view
    base[(old.base == 0) & (base < 0)] = 0
    cells.marks[part] = old.marks
    for layer, seen in zip(layers, old_layers, strict=True):
        layer.evidence[part] = seen.evidence
        layer.stamp_ns[part] = seen.stamp_ns
        layer.since_ns[part] = seen.since_ns
        _list(layer)
    settle(cells)


def take_values(cells: Cells, layer: Layer, values: NDArray[np.int8], now_ns: int) -> None:
    """Take cells of another map (rows, columns) as what a sensor has seen at a time [ns]."""
    cells.base[(values >= 0) & (values < cells.occupied) & (cells.base < 0)] = 0
    seen = values >= cells.occupied
    layer.evidence[seen] = layer.most
    layer.stamp_ns[seen] = layer.since_ns[seen] = now_ns
    cells.marks[seen] |= layer.bit
    _list(layer)
    settle(cells)


def _list(layer: Layer) -> None:
    """List the cells with evidence."""
    listed = np.flatnonzero(layer.evidence)
    layer.listed[: len(listed)] = listed
    layer.in_list[0] = len(listed)


def settle(cells: Cells) -> None:
    """Work out what the base and the marks say together."""
    cells.live[:] = np.where(cells.marks > 0, OCCUPIED, cells.base)
    cells.obstacle[:] = cells.live >= cells.occupied
    cells.blocked[:] = cells.obstacle | ((cells.live < 0) & (not cells.through_unknown))
    cells.stale[:] = True
