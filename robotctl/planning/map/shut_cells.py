"""Cells shut by zones and a fence, opened for a robot that stands in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage  # type: ignore[import-untyped]

from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import OCCUPIED
from robotctl.planning.map.body_cells import cells_at
from robotctl.planning.map.marks import Cells
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.map.take_over import settle
from robotctl.planning.map.zones import Closed


class ShutCells:
    """The cells that the robot has to keep out of.

    Parameters
    ----------
    closed
        What shuts them.
    shut
        Which cells, (rows, columns).
    behind
        Values of these cells in the map itself.
    space, cells
        The live map, whose base changes where cells are opened.
    """

    def __init__(
        self,
        closed: Closed,
        shut: NDArray[np.bool_],
        behind: NDArray[np.int8],
        space: PlanningMap,
        cells: Cells,
    ) -> None:
        self._closed = closed
        self._shut = shut
        self._behind = behind
        self._space = space
        self._cells = cells
        self._is_open = False

    def closed_at(self, pose: SE2) -> str:
        """Return the name of what the body at a pose of `world` should keep out of; else ""."""
        rows, columns = self._body_at(pose)
        shut = np.flatnonzero(self._shut[rows, columns])
        if not len(shut):
            return ""
        cell = int(rows[shut[0]]), int(columns[shut[0]])
        return self._closed.what_closes(self._space.grid, cell)

    def open_around(self, pose: SE2) -> None:
        """Let a robot that stands where it should keep out of drive out of there.

        What is shut without a gap around the pose of `world` is open until `close_behind`.
        """
        areas, _ = ndimage.label(self._shut, np.ones((3, 3)))
        around = np.unique(areas[self._body_at(pose)])
        opened = np.isin(areas, around[around > 0])
        self._cells.base[opened] = self._behind[opened[self._shut]]
        settle(self._cells)
        self._is_open = True

    def close_behind(self, pose: SE2) -> None:
        """Shut again what was opened, once the body is out of it."""
        if self._is_open and not self._shut[self._body_at(pose)].any():
            self._cells.base[self._shut] = OCCUPIED
            settle(self._cells)
            self._is_open = False

    def forget(self) -> None:
        """Note that the base is that of the beginning again, with all shut."""
        self._is_open = False

    def room_outside(self, space: PlanningMap) -> NDArray[np.bool_]:
        """Return where the robot can turn, and is out of all that is shut, (rows, columns).

        Parameters
        ----------
        space
            The whole map as it is now.
        """
        away: NDArray[np.float64] = ndimage.distance_transform_edt(~self._shut)
        roomy: NDArray[np.bool_] = np.minimum(space.clearance, away) > space.circumscribed + 0.5
        return roomy

    def _body_at(self, pose: SE2) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the cells of the map under the body at a pose of `world`."""
        return cells_at(moved(self._space.to_cells(pose), self._space.samples), self._space.shape)
