"""A small drawing surface of Unicode braille: two by four dots to a character."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator

from rich.text import Text

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))


class Canvas:
    """Draws in metres, x to the right and y up.

    A character has one style, that of what was drawn in it last.

    Parameters
    ----------
    columns, rows
        Size in characters.
    bounds
        (x_min, y_min, x_max, y_max) in metres that must be visible.
    """

    def __init__(self, columns: int, rows: int, bounds: tuple[float, float, float, float]) -> None:
        x_min, y_min, x_max, y_max = bounds
        self.columns, self.rows = columns, rows
        width, height = 2 * columns - 1, 4 * rows - 1
        self._scale = min(width / max(x_max - x_min, 1e-6), height / max(y_max - y_min, 1e-6))
        self._x_min, self._y_min = x_min, y_min
        self._cells = [[0] * columns for _ in range(rows)]
        self._marks: dict[tuple[int, int], str] = {}
        self._styles: dict[tuple[int, int], str] = {}
        self._shades: dict[tuple[int, int], str] = {}

    @classmethod
    def fitting(cls, columns: int, rows: int, bounds: tuple[float, float, float, float]) -> Canvas:
        """Return the smallest one that shows `bounds` [m] as large as the room allows."""
        x_min, y_min, x_max, y_max = bounds
        width_m, height_m = max(x_max - x_min, 1e-6), max(y_max - y_min, 1e-6)
        scale = min((2 * columns - 1) / width_m, (4 * rows - 1) / height_m)
        needed = math.ceil((scale * width_m + 1) / 2), math.ceil((scale * height_m + 1) / 4)
        return cls(max(1, min(columns, needed[0])), max(1, min(rows, needed[1])), bounds)

    def copy(self) -> Canvas:
        """Return what is drawn so far, to continue with."""
        other = copy.copy(self)
        other._cells = [list(row) for row in self._cells]
        other._marks = dict(self._marks)
        other._styles = dict(self._styles)
        other._shades = dict(self._shades)
        return other

    def point(self, x_m: float, y_m: float, style: str = "") -> None:
        """Set the dot at a point; outside nothing happens."""
        column, row = self._dot(x_m, y_m)
        if 0 <= column < 2 * self.columns and 0 <= row < 4 * self.rows:
            self._cells[row // 4][column // 2] |= _DOTS[row % 4][column % 2]
            self._styles[row // 4, column // 2] = style

    def line(self, x1_m: float, y1_m: float, x2_m: float, y2_m: float, style: str = "") -> None:
        """Draw a segment."""
        steps = max(1, math.ceil(math.hypot(x2_m - x1_m, y2_m - y1_m) * self._scale * 1.5))
        for step in range(steps + 1):
            share = step / steps
            self.point(x1_m + share * (x2_m - x1_m), y1_m + share * (y2_m - y1_m), style)

    def mark(self, x_m: float, y_m: float, character: str, style: str = "") -> None:
        """Put one character over the point."""
        column, row = self._dot(x_m, y_m)
        self._marks[row // 4, column // 2] = character
        self._styles[row // 4, column // 2] = style

    def shade(self, x_m: float, y_m: float, style: str) -> None:
        """Colour the ground of the character at a point."""
        column, row = self._dot(x_m, y_m)
        self._shades[row // 4, column // 2] = style

    def lines(self) -> Iterator[Text]:
        """Yield the rows from the top."""
        for row, cells in enumerate(self._cells):
            line = Text()
            for column, cell in enumerate(cells):
                at = row, column
                character = self._marks.get(at, chr(0x2800 + cell) if cell else " ")
                style = f"{self._styles.get(at, '')} {self._shades.get(at, '')}"
                line.append(character, style.strip())
            yield line

    def _dot(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the dot (column, row from the top) of a point."""
        column = round((x_m - self._x_min) * self._scale)
        row = 4 * self.rows - 1 - round((y_m - self._y_min) * self._scale)
        return column, row
