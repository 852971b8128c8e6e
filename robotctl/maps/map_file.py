"""ROS maps: a yaml file beside an image, for `map_server`, RViz and nav2.

How a pixel becomes a cell follows nav2's `map_server` (docs.nav2.org, Map Server; its older page is
wiki.ros.org/map_server). The shade of a pixel, 0 black to 1 white, is the average of its colours;
its occupancy p is 1 - shade, or the shade with `negate`. The first row of the image is the upper
edge of the map.

mode trinary (default)
    100 where p > `occupied_thresh`, 0 if p < `free_thresh`, else unknown. Alpha counts as one
    more colour of the average.
mode scale
    The same, but between the thresholds p becomes 0 to 100 linearly; a pixel that is not quite
    opaque is unknown.
mode raw
    The pixel's value of 0 to 255 is the cell's, above 100 unknown; thresholds and `negate` have no
    effect.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import (
    FREE,
    OCCUPIED,
    STRIP,
    UNKNOWN,
    CellRows,
    GridMap,
    count_values,
)

_IMAGES: Final = (".pgm", ".png", ".bmp", ".jpg")
MODES: Final = ("trinary", "scale", "raw")
OCCUPIED_THRESH: Final = 0.65
FREE_THRESH: Final = 0.25
"""Defaults of nav2."""

_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")

_PIXELS: Final = {FREE: 254, OCCUPIED: 0, UNKNOWN: 205}
_SAVED_FREE_THRESH: Final = 0.196
"""Value of the ROS map savers, below the occupancy of an unknown pixel, (255 - 205) / 255."""


@dataclass(frozen=True, slots=True)
class _Header:
    """Content of the yaml file."""

    image: Path
    resolution_m: float
    origin: SE2
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


def load_map(path: Path) -> GridMap:
    """Read a map.

    Parameters
    ----------
    path
        Path of the yaml file; a relative path of the image starts there.

    Raises
    ------
    ConfigError
        If the yaml file or the image is invalid; one line for each error, with file and key.
    OSError
        If a file cannot be read.
    """
    from robotctl.maps.image_file import read_image  # noqa: PLC0415 - Pillow

    header = _header(path)
    if not header.image.is_file():
        raise ConfigError(f"{path}: image: {header.image} does not exist")
    pixels = read_image(header.image)
    white = np.iinfo(pixels.dtype).max
    if pixels.ndim == 2:
        # Each shade is looked up, row by row: indices take eight bytes per cell.
        shades = np.arange(white + 1)[:, None] / white
        cell_of = _cells(shades, header, has_alpha=False)
        cells = np.empty(pixels.shape, np.int8)
        for row, shown in zip(cells, pixels[::-1], strict=True):
            row[:] = cell_of[shown]
    else:
        cells = _cells(pixels / white, header, has_alpha=pixels.shape[2] in {2, 4})[::-1].copy()
    return GridMap(cells, header.resolution_m, header.origin)


def refuse_image(name: str) -> None:
    """Raise ConfigError for the image of a map in place of the map."""
    if name.lower().endswith(_IMAGES):
        raise ConfigError(f"{name}: an image; needed is the map's .yaml that names it")


def image_of(path: Path) -> Path:
    """Return the image that a map's yaml file names.

    Raises
    ------
    ConfigError
        If the yaml file is invalid; one line for each error, with file and key.
    OSError
        If it cannot be read.
    """
    return _header(path).image


def save_map(prefix: Path, grid: CellRows) -> tuple[Path, Path]:
    """Write PREFIX.yaml and PREFIX.pgm; return their paths.

    A map of free, occupied and unknown cells is written in mode trinary; one with percentages
    between in mode raw, which keeps them.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    yaml_file = prefix.with_name(prefix.name + ".yaml")
    image_file = prefix.with_name(prefix.name + ".pgm")
    rows, columns = grid.shape
    pixel = np.arange(256, dtype=np.uint8)  # unknown, -1, becomes 255
    mode = "raw"
    if set(np.flatnonzero(count_values(grid)).tolist()) <= {value % 256 for value in _PIXELS}:
        mode = "trinary"
        for value, shade in _PIXELS.items():
            pixel[value % 256] = shade
    with image_file.open("wb") as file:
        file.write(f"P5\n{columns} {rows}\n255\n".encode("ascii"))
        for end in range(rows, 0, -STRIP):
            strip = grid.rows(max(end - STRIP, 0), end)[::-1]
            file.writelines(pixel.take(row.view(np.uint8)).tobytes() for row in strip)
    origin = grid.origin
    yaml_file.write_text(
        f"image: {_quoted(image_file.name)}\n"
        f"mode: {mode}\n"
        f"resolution: {grid.resolution_m!r}\n"
        f"origin: [{origin.x_m!r}, {origin.y_m!r}, {origin.theta_rad!r}]\n"
        "negate: 0\n"
        f"occupied_thresh: {OCCUPIED_THRESH}\n"
        f"free_thresh: {_SAVED_FREE_THRESH}\n",
        encoding="utf-8",
    )
    return yaml_file, image_file


def _quoted(name: str) -> str:
    """Return a file's name as a yaml string."""
    import yaml  # noqa: PLC0415 - most runs need no file of a map

    return str(yaml.safe_dump(name, default_style='"', width=math.inf, allow_unicode=True)).strip()


def _header(path: Path) -> _Header:
    """Read the yaml file; all its errors are reported at once."""
    import yaml  # noqa: PLC0415

    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # yaml does not wrap errors of Python's numbers and dates, and of deep brackets.
        raise ConfigError(f"{path}: not valid YAML: {error}") from error
    if not isinstance(data, dict):
        raise ConfigError(f"{path}: a map needs `key: value` lines, {', '.join(_KEYS)}")
    problems, values = [], {}
    for key, check in _KEYS.items():
        try:
            values[key] = check(data.get(key, _DEFAULTS.get(key)))
        except ValueError as error:
            found = f", found {data[key]!r}" if key in data else f", missing{_near(key, data)}"
            problems.append(f"{path}: {key}: {error}{found}")
    for key in data:
        near = difflib.get_close_matches(str(key), _KEYS, n=1, cutoff=0.8)
        if key not in _KEYS and near and near[0] not in data:
            problems.append(f'{path}: {key}: unknown key; did you mean "{near[0]}"?')
    if not problems and values["free_thresh"] > values["occupied_thresh"]:
        problems.append(
            f"{path}: free_thresh: must not be above occupied_thresh, found "
            f"{values['free_thresh']:g} and {values['occupied_thresh']:g}"
        )
    if problems:
        raise ConfigError("\n".join(problems))
    return _Header(
        path.parent / values["image"],
        values["resolution"],
        SE2(*values["origin"]),
        values["mode"],
        values["negate"],
        values["occupied_thresh"],
        values["free_thresh"],
    )


def _near(key: str, data: dict[Any, Any]) -> str:
    """Return a hint at a key that is probably a misspelt `key`."""
    others = [str(each) for each in data if each not in _KEYS]
    near = difflib.get_close_matches(key, others, n=1)
    return f' (is "{near[0]}" meant to be it?)' if near else ""


def _number(value: object) -> float:
    """Return a finite number.

    Text counts if C++ or Python prints a number that way, `1e-05` or in quotes: YAML 1.1 reads
    text, and `map_server` a number.
    """
    if isinstance(value, str) and _NUMBER.fullmatch(value.strip()):
        value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("must be a finite number")
    with suppress(OverflowError):  # from a whole number of hundreds of digits
        if math.isfinite(number := float(value)):
            return number
    raise ValueError("must be a finite number")


def _resolution(value: object) -> float:
    """Return the side of a cell [m]."""
    try:
        side_m = _number(value)
    except ValueError:
        side_m = 0.0
    if side_m <= 0.0:
        raise ValueError("must be a number of metres above 0")
    return side_m


def _threshold(value: object) -> float:
    """Return a probability."""
    threshold = _number(value)
    if not 0.0 <= threshold <= 1.0:
        raise ValueError("must lie in [0, 1]")
    return threshold


def _origin(value: object) -> list[float]:
    """Return x [m], y [m] and yaw [rad] of the map's lower left corner."""
    message = "must be [x, y, yaw], three finite numbers in metres and radians"
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(message)
    try:
        return [_number(each) for each in value]
    except ValueError as error:
        raise ValueError(message) from error


def _image(value: object) -> str:
    """Return the name of the image."""
    if not isinstance(value, str) or not value:
        raise ValueError("must be the path of an image")
    return value


def _mode(value: object) -> str:
    """Return the name of the mode, in lower case."""
    if not isinstance(value, str) or value.lower() not in MODES:
        raise ValueError(f"must be one of {', '.join(MODES)}")
    return value.lower()


def _negate(value: object) -> bool:
    """Return whether white is occupied."""
    if isinstance(value, str):
        value = {"0": 0, "1": 1, "false": 0, "true": 1}.get(value.strip().lower())
    if not isinstance(value, bool | int) or value not in {0, 1}:
        raise ValueError("must be 0, 1, true or false")
    return bool(value)


_KEYS: Final[dict[str, Callable[[object], Any]]] = {
    "image": _image,
    "resolution": _resolution,
    "origin": _origin,
    "mode": _mode,
    "negate": _negate,
    "occupied_thresh": _threshold,
    "free_thresh": _threshold,
}
_DEFAULTS: Final = {
    "mode": "trinary",
    "negate": 0,
    "occupied_thresh": OCCUPIED_THRESH,
    "free_thresh": FREE_THRESH,
}


def _cells(pixels: NDArray[np.float64], header: _Header, *, has_alpha: bool) -> NDArray[np.int8]:
    """Return the cells of pixels of 0 to 1, (..., channels), as (...)."""
    alpha = pixels[..., -1] if has_alpha else None
    opaque = pixels if alpha is None else pixels[..., :-1]
    shade = (pixels if header.mode == "trinary" else opaque).mean(axis=-1)
    if header.mode == "raw":
        value = np.rint(255.0 * shade)
        return np.where(value <= OCCUPIED, value, UNKNOWN).astype(np.int8)
    p = shade if header.negate else 1.0 - shade
    low, high = header.free_thresh, header.occupied_thresh
    if header.mode == "trinary":
        between = np.full(p.shape, float(UNKNOWN))
    else:
        between = np.rint(100.0 * (p - low) / max(high - low, 1e-9))
    cells = np.select([p > high, p < low], [float(OCCUPIED), float(FREE)], between)
    if header.mode == "scale" and alpha is not None:
        cells[alpha < 1.0] = UNKNOWN
    return cells.astype(np.int8)
