"""Printed patterns: chessboards and square markers, found in pictures and drawn to be printed.

The frame of a sheet: its origin in the middle, x in the direction of the printed arrow, which is
up, y to the left, as `base` has it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

MARKERS: Final[dict[str, int]] = {
    "4x4_50": cv2.aruco.DICT_4X4_50,
    "5x5_100": cv2.aruco.DICT_5X5_100,
    "6x6_250": cv2.aruco.DICT_6X6_250,
    "apriltag_16h5": cv2.aruco.DICT_APRILTAG_16h5,
    "apriltag_25h9": cv2.aruco.DICT_APRILTAG_25h9,
    "apriltag_36h11": cv2.aruco.DICT_APRILTAG_36h11,
}
"""The families of markers that are known: ArUco (Garrido-Jurado 2014) and AprilTag (Olson 2011)."""
PX_PER_MM: Final = 10
MOST_CORNERS: Final = 50
"""Maximum corners along a side of a board."""
_BORDER_MM = 10
"""Minimum white border of a printed pattern [mm]."""
_ENLARGED = 2
"""Factor by which a picture is enlarged in the search for small markers."""
_LEAST_WINDOW_PX = 2
_MOST_WINDOW_PX = 11
"""Bounds of half the side of the window in which a corner is refined [px]."""


@dataclass(frozen=True, slots=True)
class Board:
    """A chessboard.

    Parameters
    ----------
    columns, rows
        Inner corners across and along the arrow, 3 to 50.
    square_m
        Side of a square [m].

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    def __post_init__(self) -> None:
        if not (min(self.columns, self.rows) >= 3 and max(self.columns, self.rows) <= MOST_CORNERS):
            raise ValueError(
                f"a board has 3 to 50 inner corners a side, not {self.columns} x {self.rows}"
            )
        if not 0.001 <= self.square_m <= 1.0:
            raise ValueError(f"squares are 1 to 1000 mm wide, not {1e3 * self.square_m:g}")

    def corners(self) -> NDArray[np.float64]:
        """Return the inner corners in the frame of the sheet, (n, 2) [m].

        Row by row from the far end of the arrow, each from left to right, as they are found.
        """
        x_m = (0.5 * (self.rows - 1) - np.arange(self.rows)) * self.square_m
        y_m = (0.5 * (self.columns - 1) - np.arange(self.columns)) * self.square_m
        return np.column_stack([np.repeat(x_m, self.columns), np.tile(y_m, self.rows)])

    def turned(self, corners: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Return found corners, (n, 2), in each order that is possible for the board.

        Turned by half, and by quarters if it is square; its looks do not say which it is.
        """
        grid = corners.reshape(self.rows, self.columns, 2)
        quarters = (0, 1, 2, 3) if self.rows == self.columns else (0, 2)
        return [np.rot90(grid, k).reshape(-1, 2).copy() for k in quarters]


def find_corners(picture: NDArray[np.uint8], board: Board) -> NDArray[np.float64] | None:
    """Find the inner corners of a chessboard.

    Parameters
    ----------
    picture
        (height, width, 3), blue, green, red.
    board
        The pattern.

    Returns
    -------
    ndarray or None
        (u, v), (n, 2) [px], row by row, in one of the orders of `Board.turned`; None if the board
        is not seen whole.
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    size = (board.columns, board.rows)
    found, rough = cv2.findChessboardCorners(grey, size)
    if not found:
        # Slower, and finds flat and blurred ones too (Duda and Frese 2018).
        found, rough = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        return None
    corners = rough.reshape(board.rows, board.columns, 2)
    spacing_px = min(
        float(np.linalg.norm(np.diff(corners, axis=axis), axis=2).min()) for axis in (0, 1)
    )
    # The window must not reach the next corner.
    half = int(np.clip(0.4 * spacing_px, _LEAST_WINDOW_PX, _MOST_WINDOW_PX))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    fine = cv2.cornerSubPix(
        grey, corners.reshape(-1, 1, 2).astype(np.float32), (half, half), (-1, -1), criteria
    )
    grid = fine.reshape(board.rows, board.columns, 2).astype(np.float64)
    right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if right[0] * down[1] - right[1] * down[0] < 0.0:
        grid = grid[:, ::-1]
    return grid.reshape(-1, 2).copy()


def larger_board(picture: NDArray[np.uint8], board: Board) -> Board | None:
    """Return the board in a picture, (height, width, 3), of which `board` is a part.

    Up to two corners more on a side; None: there is none. Where the board ends at something dark
    it may see a row too many: ask, do not refuse.
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    for more in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2)):
        size = (board.columns + more[0], board.rows + more[1])
        if (
            max(size) <= MOST_CORNERS
            and cv2.findChessboardCorners(
                grey, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
            )[0]
        ):
            return replace(board, columns=size[0], rows=size[1])
    return None


def find_markers(picture: NDArray[np.uint8], family: str) -> dict[int, NDArray[np.float64]]:
    """Find square markers.

    Parameters
    ----------
    picture
        (height, width, 3), blue, green, red.
    family
        A key of `MARKERS`.

    Returns
    -------
    dict
        The pixel (2,) of each marker's middle, where its diagonals meet; of a marker that is seen
        twice none.
    """
    parameters = cv2.aruco.DetectorParameters()
    # Lines through the contour of each side: on a floor seen at a low angle a window about a corner
    # reaches the next one.
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
    detector = cv2.aruco.ArucoDetector(_dictionary(family), parameters)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    large = cv2.resize(grey, None, fx=_ENLARGED, fy=_ENLARGED, interpolation=cv2.INTER_CUBIC)
    corners, ids, _ = detector.detectMarkers(large)
    names = [] if ids is None else [int(each) for each in ids.ravel()]
    return {
        name: (_middle(np.asarray(each, dtype=float).reshape(4, 2)) + 0.5) / _ENLARGED - 0.5
        for name, each in zip(names, corners, strict=True)
        if names.count(name) == 1
    }


def draw_board(board: Board) -> NDArray[np.uint8]:
    """Return a chessboard to print, grey, at `PX_PER_MM`, with an arrow and its size as text.

    Raises
    ------
    ValueError
        If a side would be over two metres.
    """
    side = round(1e3 * board.square_m * PX_PER_MM)
    rows, columns = np.indices((board.rows + 1, board.columns + 1))
    squares = np.where((rows + columns) % 2 == 0, 0, 255).astype(np.uint8)
    words = f"{board.columns}x{board.rows} inner corners, squares {1e3 * board.square_m:g} mm"
    return _sheet(np.kron(squares, np.ones((side, side), np.uint8)), words, max(side // 2, 100))


def draw_marker(family: str, number: int, side_m: float) -> NDArray[np.uint8]:
    """Return a marker to print, as `draw_board`; `side_m` is the side of its black square [m].

    Raises
    ------
    ValueError
        If the family has no such marker, or a side would be over two metres.
    """
    dictionary = _dictionary(family)
    count = len(dictionary.bytesList)
    if not 0 <= number < count:
        raise ValueError(f"{family} has the markers 0 to {count - 1}, not {number}")
    cells = dictionary.markerSize + 2
    side = max(1, round(1e3 * side_m * PX_PER_MM / cells))
    small = cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=1)
    words = f"{family} {number}, {side * cells / PX_PER_MM:g} mm"
    large = np.kron(small, np.ones((side, side))).astype(np.uint8)
    return _sheet(large, words, max(side, 100))


def _sheet(pattern: NDArray[np.uint8], words: str, least_border: int) -> NDArray[np.uint8]:
    """Return a pattern on white, with an arrow up and words below."""
    border = max(_BORDER_MM * PX_PER_MM, least_border)
    if max(pattern.shape) + 2 * border > 2000 * PX_PER_MM:
        raise ValueError("that is larger than two metres")
    sheet = np.pad(pattern, border, constant_values=255)
    height, width = sheet.shape
    tip = (width // 2, border // 8)
    cv2.arrowedLine(sheet, (width // 2, border * 3 // 4), tip, 0, PX_PER_MM // 2, tipLength=0.4)
    scale = border / 150.0
    font = cv2.FONT_HERSHEY_SIMPLEX
    (long, _), _ = cv2.getTextSize(words, font, scale, 2)
    scale *= min(1.0, 0.95 * width / long)
    cv2.putText(sheet, words, (border // 4, height - border // 3), font, scale, 0, 2, cv2.LINE_AA)
    return sheet.astype(np.uint8, copy=False)


def _dictionary(family: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(MARKERS[family])


def _middle(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the diagonals of a quadrangle, (4, 2), meet, (2,)."""
    a, b, c, d = corners
    along, across = c - a, d - b
    share = np.linalg.solve(np.column_stack([along, -across]), b - a)[0]
    middle: NDArray[np.float64] = a + share * along
    return middle
