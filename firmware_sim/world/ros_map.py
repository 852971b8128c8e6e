"""Rooms from ROS maps: `map.yaml` beside an image, read as by its `map_server`.

The file's format is that of docs.nav2.org, Map Server. A cell is a wall from 50 % on: in mode
trinary the occupied ones.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from firmware_sim.errors import SimulationError
from firmware_sim.world.cells import Cells

SUFFIXES = (".yaml", ".yml")
_DEFAULTS = {"mode": "trinary", "negate": "0", "occupied_thresh": "0.65", "free_thresh": "0.25"}
_FORMATS = ("PPM", "PNG", "BMP", "JPEG", "GIF", "TIFF", "WEBP", "TGA")
_MODES = {(False, False): "RGB", (False, True): "RGBA", (True, False): "L", (True, True): "LA"}
"""Modes of Pillow, by whether an image is grey and has alpha."""
_FALSE, _TRUE = ("0", "false"), ("1", "true")


def load_cells(path: Path) -> Cells:
    """Read a map.

    Raises
    ------
    SimulationError
        If yaml file or image cannot be read or is invalid.
    """
    header = _DEFAULTS | _header(path)
    origin = header.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise SimulationError(f"{path}: origin: must be [x, y, yaw], found {origin}")
    mode, negate = str(header["mode"]).lower(), str(header["negate"]).lower()
    if mode not in {"trinary", "scale", "raw"} or negate not in {*_FALSE, *_TRUE}:
        raise SimulationError(
            f"{path}: mode must be trinary, scale or raw, and negate 0 or 1; found {mode}, {negate}"
        )
    side_m = _number(path, "resolution", header.get("resolution"))
    if side_m <= 0.0:
        raise SimulationError(f"{path}: resolution: must be above 0 m, found {side_m:g}")
    x, y, theta = (_number(path, "origin", each) for each in origin)
    low, high = (_number(path, key, header[key]) for key in ("free_thresh", "occupied_thresh"))
    channels, has_alpha = _image(path, str(header.get("image", "")))
    percent = _percent(channels, low, high, mode, has_alpha=has_alpha, negate=negate in _TRUE)
    lowest_first = percent[::-1]
    occupied, free = lowest_first >= 50.0, (lowest_first >= 0.0) & (lowest_first < 50.0)
    return Cells(occupied, free, side_m, (x, y, theta))


def _header(path: Path) -> dict[str, Any]:
    """Return the content of the yaml file, all as text, since YAML 1.1 reads `1e-05` as such."""
    import yaml  # noqa: PLC0415 - few rooms are ROS maps

    try:
        # BaseLoader returns only text, lists and tables.
        header = yaml.load(path.read_text(encoding="utf-8"), yaml.BaseLoader)  # noqa: S506
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        raise SimulationError(f"{path}: cannot be read: {error}") from error
    if not isinstance(header, dict):
        raise SimulationError(f"{path}: is no map: needed are image, resolution and origin")
    return header


def _number(path: Path, key: str, text: object) -> float:
    """Return a finite number."""
    try:
        value = float(text) if isinstance(text, str) else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SimulationError(f"{path}: {key}: must be a finite number, found {text}")
    return value


def _image(path: Path, name: str) -> tuple[np.ndarray, bool]:
    """Return the channels, (rows, columns, n) of 0 to 1, and whether the last of them is alpha."""
    from PIL import Image  # noqa: PLC0415

    file = path.parent / name
    try:
        with Image.open(file, formats=_FORMATS) as image:
            has_alpha = image.has_transparency_data
            if image.mode.startswith("I"):  # 16 bits
                return np.asarray(image)[..., None] / 65535.0, False
            is_grey = image.mode in {"1", "L", "LA"}
            pixels = np.asarray(image.convert(_MODES[is_grey, has_alpha])) / 255.0
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise SimulationError(f"{path}: image: {file}: {error}") from error
    return np.atleast_3d(pixels), has_alpha


def _percent(
    channels: np.ndarray, low: float, high: float, mode: str, *, has_alpha: bool, negate: bool
) -> np.ndarray:
    """Return the occupancy of each pixel, 0 to 100, or -1 if unknown."""
    counted = channels[..., :-1] if has_alpha and mode != "trinary" else channels
    shade: np.ndarray = counted.mean(axis=2)
    if mode == "raw":
        value = np.rint(255.0 * shade)
        return np.where(value > 100.0, -1.0, value)
    p = shade if negate else 1.0 - shade
    if mode == "trinary":
        return np.where(p > high, 100.0, np.where(p < low, 0.0, -1.0))
    percent = np.clip(np.rint(100.0 * (p - low) / max(high - low, 1e-9)), 0.0, 100.0)
    if has_alpha:
        percent[channels[..., -1] < 1.0] = -1.0
    return percent
