"""Tables of points: clicked pixels, places on the floor, or both."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError
from robotctl.toml_source import nearest

PIXELS = ("u", "v")
PLACES = ("x", "y")


def read_columns(path: Path, keys: Sequence[str]) -> NDArray[np.float64]:
    """Read columns of numbers from a CSV with a heading; other columns are left alone.

    Parameters
    ----------
    path
        The file; lines that are empty or begin with # are left out.
    keys
        Which columns, named as in the heading.

    Returns
    -------
    ndarray
        (n, len(keys)), n >= 1.

    Raises
    ------
    ConfigError
        If a column is missing or a number is none; one line for each error.
    OSError
        If the file cannot be read.
    """
    lines = _lines(path)
    if not lines:
        raise ConfigError(f"{path}: empty; needed is a heading with {', '.join(keys)}")
    heading = [name.strip() for name in lines[0][1]]
    missing = [key for key in keys if key not in heading]
    if missing:
        _refuse_separator(path, lines, keys)
        problems = [
            f"{path}:{lines[0][0]}: no column {key}{nearest(key, heading)}" for key in missing
        ]
        raise ConfigError("\n".join(problems))
    places = [heading.index(key) for key in keys]
    rows, problems = [], []
    for number, cells in lines[1:]:
        row = [_number(cells[place]) if place < len(cells) else None for place in places]
        problems += [
            f"{path}:{number}: {key}: {_found(cells, place)}, a finite number is needed"
            for key, value, place in zip(keys, row, places, strict=True)
            if value is None
        ]
        if any(cell.strip() for cell in cells[len(heading) :]):
            problems.append(
                f"{path}:{number}: {len(cells)} cells, the heading has {len(heading)}; are there "
                "decimal commas? Needed are points"
            )
        rows.append([math.nan if value is None else value for value in row])
    if problems:
        raise ConfigError("\n".join(problems))
    if not rows:
        raise ConfigError(f"{path}: no rows below the heading")
    return np.array(rows, dtype=float)


def write_columns(path: Path, keys: Sequence[str], rows: NDArray[np.float64]) -> None:
    """Write a CSV with a heading; numbers to a tenth of a millimetre or of a pixel, nan empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(keys)
        for row in rows:
            writer.writerow("" if math.isnan(value) else f"{value:.4f}" for value in row)


def _lines(path: Path) -> list[tuple[int, list[str]]]:
    """Return the cells of each non-empty line, with its number."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file") from None
    lines = enumerate(text.splitlines(), 1)
    return [
        (number, next(csv.reader([line])))
        for number, line in lines
        if line.strip() and not line.lstrip().startswith("#")
    ]


def _refuse_separator(
    path: Path, lines: Sequence[tuple[int, list[str]]], keys: Sequence[str]
) -> None:
    """Raise ConfigError where columns are separated by something else than commas."""
    number = lines[0][0]
    texts = [",".join(cells) for _, cells in lines]
    for separator, name in ((";", "';'"), ("\t", "tabs"), (None, "spaces")):
        if set(keys) <= {key.strip() for key in texts[0].split(separator)}:
            decimals = any("," in text for text in texts[1:])
            commas = ", and its numbers have decimal commas" if decimals else ""
            points = " and decimal points" if decimals else ""
            raise ConfigError(
                f"{path}:{number}: the columns are separated by {name}{commas}; needed are commas"
                f"{points}"
            )


def _found(cells: Sequence[str], place: int) -> str:
    """Return the content of a cell that is no number."""
    if place >= len(cells):
        return f"{len(cells)} cells in the line"
    text = cells[place].strip()
    comma = ", with a decimal comma" if _number(text.replace(",", ".")) is not None else ""
    return f"found {text[:24]!r}{comma}"


def _number(text: str) -> float | None:
    """Return a finite number, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
