"""Grid maps of the MovingAI benchmarks, `.map`.

Source: N. Sturtevant, "Benchmarks for grid-based pathfinding", 2012, and movingai.com: four lines
of header (`type octile`, `height`, `width`, `map`), then the cells, the top row first; `.` and `G`
are passable, and so is `S` (swamp); all others are not.
"""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.errors import ConfigError
from robotctl.model.grid_map import FREE, OCCUPIED, GridMap

SUFFIXES: Final = (".map", ".map.gz")
_PASSABLE: Final = b".GS"
_CELLS: Final = b".GS@OTW"
_LARGEST: Final = 1 << 26
"""Maximum cells of a map (64 MB)."""


def is_moving_ai(path: Path) -> bool:
    """Return whether a file has the suffix of such a map."""
    return path.name.lower().endswith(SUFFIXES)


def load_moving_ai(path: Path) -> GridMap:
    """Return a map whose cells have sides of 1, the lowest row of the file first.

    Raises
    ------
    ConfigError
        If it cannot be read; with line, what was found, and what is allowed.
    """
    lines = _lines(path)
    rows, columns = _size(lines, path)
    for number, line in enumerate(lines[4 : 4 + rows], 5):
        if len(line) != columns:
            raise ConfigError(f"{path}:{number}: {len(line)} cells, the map is {columns} wide")
        if wrong := set(line) - set(_CELLS):
            found = chr(min(wrong))
            raise ConfigError(f"{path}:{number}: {found!r} is no cell; {_CELLS.decode()} are")
    letters = np.frombuffer(b"".join(lines[4 : 4 + rows]), np.uint8).reshape(rows, columns)
    passable = np.isin(letters, np.frombuffer(_PASSABLE, np.uint8))
    cells = np.where(passable, FREE, OCCUPIED).astype(np.int8)
    return GridMap(np.ascontiguousarray(cells[::-1]), 1.0)


def _lines(path: Path) -> list[bytes]:
    """Return the lines of a file, packed or not."""
    try:
        data = path.read_bytes()
        if path.suffix == ".gz":
            data = gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    return data.replace(b"\r\n", b"\n").removesuffix(b"\n").split(b"\n")


def _size(lines: list[bytes], path: Path) -> tuple[int, int]:
    """Return the rows and columns stated by the header."""
    header = [line.decode("ascii", "replace").split() for line in lines[:4]]
    sizes = {
        words[0]: int(words[1])
        for words in header
        if len(words) == 2 and words[0] in ("height", "width") and words[1].isdecimal()
    }
    if sizes.keys() != {"height", "width"} or header[3:] != [["map"]]:
        raise ConfigError(
            f"{path}: begins with {b' '.join(lines[:4])[:60].decode('ascii', 'replace')!r}; a "
            "MovingAI map begins with the lines `type octile`, `height N`, `width N` and `map`"
        )
    rows, columns = sizes["height"], sizes["width"]
    if not 0 < rows * columns <= _LARGEST:
        raise ConfigError(f"{path}: {columns} x {rows} cells; 1 to {_LARGEST} are allowed")
    if len(lines) < 4 + rows:
        raise ConfigError(f"{path}: cut short: {len(lines) - 4} of {rows} rows")
    return rows, columns
