"""Points of the floor and their pixels: clicked, of markers, of a board."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.camera.calibration.pattern import Board, find_corners, find_markers
from robotctl.model.geometry.points import moved
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.camera.points import PIXELS, PLACES, read_columns


@dataclass(frozen=True, slots=True)
class FloorPoints:
    """Points of the floor and where they are seen.

    Parameters
    ----------
    names
        One for each.
    ground
        (n, 2) in `base` [m].
    pixels
        (n, 2) [px].
    """

    names: tuple[str, ...]
    ground: NDArray[np.float64]
    pixels: NDArray[np.float64]

    @staticmethod
    def none() -> FloorPoints:
        """Return no points."""
        return FloorPoints((), np.empty((0, 2)), np.empty((0, 2)))

    def joined(self, other: FloorPoints) -> FloorPoints:
        """Return these and then the others."""
        return FloorPoints(
            self.names + other.names,
            np.vstack([self.ground, other.ground]),
            np.vstack([self.pixels, other.pixels]),
        )


def clicked_points(file: Path) -> FloorPoints:
    """Return the points of a CSV (u, v, x, y); raises ConfigError if it is wrong."""
    table = read_columns(file, (*PIXELS, *PLACES))
    names = tuple(f"point {k}" for k in range(1, len(table) + 1))
    return FloorPoints(names, table[:, 2:], table[:, :2])


def markers_seen(picture: NDArray[np.uint8], file: Path, family: str) -> FloorPoints:
    """Return the markers of a CSV (id, x, y) that are seen in a picture.

    Raises
    ------
    ConfigError
        If the file is wrong, or a marker is named twice.
    CalibrationError
        If none is seen.
    """
    places = _places(file)
    seen = find_markers(picture, family)
    both = sorted(set(seen) & set(places))
    if not both:
        others = f", but {family} {sorted(seen)}" if seen else f", and no other {family}"
        raise CalibrationError(f"none of the markers of {file} is seen{others}")
    return FloorPoints(
        tuple(_name(each) for each in both),
        np.array([places[each] for each in both]),
        np.array([seen[each] for each in both]),
    )


def markers_unseen(file: Path, seen: FloorPoints) -> list[str]:
    """Return the names of the markers of a CSV that are not among points."""
    names = [_name(each) for each in sorted(_places(file))]
    return [name for name in names if name not in seen.names]


def _places(file: Path) -> dict[int, NDArray[np.float64]]:
    """Return the places of the markers of a CSV; raises ConfigError if it is wrong."""
    table = read_columns(file, ("id", *PLACES))
    places = {int(row[0]): row[1:] for row in table}
    if len(places) < len(table) or np.any(table[:, 0] != np.floor(table[:, 0])):
        raise ConfigError(f"{file}: id: each marker once, by its whole number")
    return places


def _name(number: int) -> str:
    return f"marker {number}"


def board_seen(picture: NDArray[np.uint8], file: Path, board: Board, at: SE2) -> list[FloorPoints]:
    """Return the corners of a board at a place in `base`, in each order that is possible.

    Raises
    ------
    CalibrationError
        If it is not seen in the picture of this file.
    """
    corners = find_corners(picture, board)
    if corners is None:
        raise CalibrationError(
            f"{file}: no chessboard of {board.columns} x {board.rows} inner corners is fully "
            "visible; is --board right, is there white around it, does it lie flat?"
        )
    ground = moved(at, board.corners())
    names = tuple(f"corner {k}" for k in range(1, len(ground) + 1))
    return [FloorPoints(names, ground, order) for order in board.turned(corners)]
