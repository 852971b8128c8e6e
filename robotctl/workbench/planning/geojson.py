"""Zones from GeoJSON (RFC 7946), as GIS programs and drawing tools write it.

Each polygon is a zone, and each piece of a line one as wide as the line. `name`, `speed_m_s` and,
of lines, `width_m` are properties of the feature.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

from robotctl.errors import ConfigError, InvalidValue
from robotctl.mavlink.globe import Origin
from robotctl.planning.map.zone import Point, Zone

ToWorld: TypeAlias = Callable[[float, float], Point]
"""x and y in `world` [m] of two coordinates."""

_WIDTH_M: Final = 0.1
"""Width of a line that has none of its own [m]."""
_SHAPES: Final = ("Polygon", "MultiPolygon", "LineString", "MultiLineString")
_ROUND_M: Final = 4
"""Decimal places of corners in metres."""


def on_globe(origin: Origin) -> ToWorld:
    """Return what takes longitude and latitude [deg], in this order."""
    return lambda longitude_deg, latitude_deg: origin.to_world(latitude_deg, longitude_deg)


def in_metres(x_m: float, y_m: float) -> Point:
    """Return coordinates of `world` as they are."""
    return x_m, y_m


def load_zones(path: Path, to_world: ToWorld) -> list[Zone]:
    """Read all zones of a file.

    Raises
    ------
    ConfigError
        If it is no GeoJSON, or a feature is no zone; it names file, feature and what was found.
    """
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: no GeoJSON: {error}") from error
    kind = found.get("type") if isinstance(found, dict) else None
    if kind not in {"FeatureCollection", "Feature"}:
        raise ConfigError(
            f"{path}: type {kind!r} found, 'FeatureCollection' or 'Feature' is allowed"
        )
    features = found.get("features") if kind == "FeatureCollection" else [found]
    if not isinstance(features, list) or not features:
        raise ConfigError(f"{path}: features: none found")
    zones: list[Zone] = []
    for number, feature in enumerate(features):
        try:
            zones += _zones_of(feature, number, to_world)
        except (InvalidValue, ValueError, TypeError) as error:
            raise ConfigError(f"{path}: features[{number}]: {error}") from error
    return zones


def as_toml(zones: Sequence[Zone], table: str) -> str:
    """Return zones as they stand in a file, each as `[[table]]`."""
    return "\n".join(
        f"[[{table}]]\n"
        f"name = {json.dumps(zone.name, ensure_ascii=False)}\n"
        f"corners = {[list(corner) for corner in zone.corners]}\n"
        f"speed_m_s = {zone.speed_m_s!r}\n"
        for zone in zones
    )


def _zones_of(feature: Any, number: int, to_world: ToWorld) -> Iterator[Zone]:
    """Yield the zones of a feature; `ValueError`: it has none."""
    shape = feature.get("geometry") if isinstance(feature, dict) else None
    kind = shape.get("type") if isinstance(shape, dict) else None
    if kind not in _SHAPES or not isinstance(shape, dict) or "coordinates" not in shape:
        raise ValueError(f"geometry: {kind!r} found, coordinates of {', '.join(_SHAPES)} allowed")
    values: Mapping[str, Any] = feature.get("properties") or {}
    name = str(values.get("name") or f"zone {number + 1}")
    speed_m_s = _number(values, "speed_m_s", 0.0)
    parts = shape["coordinates"] if kind.startswith("Multi") else [shape["coordinates"]]
    if kind.endswith("Polygon"):
        outlines = [_outline(rings, to_world) for rings in parts]
    else:
        width_m = _number(values, "width_m", _WIDTH_M)
        outlines = [each for line in parts for each in _strips(line, width_m, to_world)]
    for count, corners in enumerate(outlines, 1):
        named = name if len(outlines) == 1 else f"{name} {count}"
        rounded = tuple((round(x_m, _ROUND_M), round(y_m, _ROUND_M)) for x_m, y_m in corners)
        yield Zone(named, rounded, speed_m_s)


def _outline(rings: Any, to_world: ToWorld) -> list[Point]:
    """Return the corners of a polygon [m], without its closing one."""
    if len(rings) != 1:
        raise ValueError("a polygon with a hole, and zones have none: divide it")
    corners = _points(rings[0], to_world)
    return corners[:-1] if corners and corners[0] == corners[-1] else corners


def _strips(line: Any, width_m: float, to_world: ToWorld) -> Iterator[list[Point]]:
    """Yield a rectangle for each piece of a line, longer by half its width at both ends."""
    if not 0.0 < width_m <= 100.0:
        raise ValueError(f"width_m: {width_m:g} found, above 0 to 100 allowed")
    half = 0.5 * width_m
    for (ax, ay), (bx, by) in itertools.pairwise(_points(line, to_world)):
        length = math.hypot(bx - ax, by - ay)
        if length == 0.0:
            continue
        ux, uy = half * (bx - ax) / length, half * (by - ay) / length
        yield [
            (ax - ux + uy, ay - uy - ux),
            (bx + ux + uy, by + uy - ux),
            (bx + ux - uy, by + uy + ux),
            (ax - ux - uy, ay - uy + ux),
        ]


def _points(coordinates: Any, to_world: ToWorld) -> list[Point]:
    """Return positions in `world` [m]; a third coordinate, the height, counts for nothing."""
    found = []
    for position in coordinates:
        if (
            not isinstance(position, list)
            or len(position) not in (2, 3)
            or not all(isinstance(each, int | float) and math.isfinite(each) for each in position)
        ):
            raise ValueError(f"coordinates: {position} found, two or three numbers are allowed")
        found.append(to_world(float(position[0]), float(position[1])))
    return found


def _number(values: Mapping[str, Any], key: str, default: float) -> float:
    """Return a property that is a number."""
    value = values.get(key)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{key}: {value!r} found, a number is allowed")
    return float(value)
