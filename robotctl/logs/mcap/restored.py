"""Messages as published by the robot, restored from its log.

The inverse of `logs.mcap.forms`, `foxglove` and `schema.plain`. Values missing in a log, from
another version or not finite, are nan, empty or the default of their field.
"""

from __future__ import annotations

import enum
import math
import types
from base64 import b64decode
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, Final, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.logs.mcap.foxglove import OUT_OF_RANGE_M, severity_of
from robotctl.messages.control import ControlState, NavigationState, Notice
from robotctl.messages.estimation import (
    CameraView,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
)

Content: TypeAlias = Mapping[str, Any]
Restored: TypeAlias = ControlState | NavigationState | LocalisationState | LidarScan | Notice
"""Restored message of a process."""
S = TypeVar("S", bound=msgspec.Struct)

_PACKED: Final = {1: "u1", 2: "i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4", 7: "<f4", 8: "<f8"}
"""`foxglove.NumericType` as types of NumPy."""
_POSE: Final = ("x_m", "y_m", "theta_rad")


def control_state(stamp_ns: int, content: Content) -> ControlState:
    """Return a message of the topic `control`."""
    fields = _with_pose(content, "T_odom_base")
    if "sonars" in content:
        fields["sonar_m"] = [_range_m(each) for each in content["sonars"]]
        fields["sonar_stamp_ns"] = [each["stamp_ns"] for each in content["sonars"]]
    elif "sonar_m" in content:  # of older versions, null: no echo
        fields["sonar_m"] = [math.inf if each is None else each for each in content["sonar_m"]]
    return _filled(ControlState, fields, stamp_ns)


def navigation_state(stamp_ns: int, content: Content) -> NavigationState:
    """Return a message of the topic `navigation`."""
    return _filled(NavigationState, content, stamp_ns)


def localisation_state(stamp_ns: int, content: Content) -> LocalisationState:
    """Return a message of the topic `localisation`."""
    return _filled(LocalisationState, _with_pose(content, "T_world_odom"), stamp_ns)


def camera_view(stamp_ns: int, content: Content) -> CameraView:
    """Return a message of the topic `camera`."""
    fields = dict(content)
    beams = fields.pop("beams", None)
    if beams is not None:
        fields["angles_rad"] = [each["angle_rad"] for each in beams]
        fields["ranges_m"] = [_range_m(each) for each in beams]
        for name, part in (("sigmas_m", "sigma_m"), ("nearest_m", "nearest_m")):
            fields[name] = [each.get(part, math.nan) for each in beams]
    return _filled(CameraView, fields, stamp_ns)


def lidar_scan(stamp_ns: int, content: Content) -> LidarScan:
    """Return a message of the topic `lidar`, a `foxglove.LaserScan`."""
    written = [math.inf if each is None else each for each in content["ranges"]]
    ranges = np.array(written, np.float32)
    ranges[ranges >= OUT_OF_RANGE_M] = math.inf
    ranges[ranges <= -OUT_OF_RANGE_M] = math.nan
    first_rad = content["start_angle"]
    step_rad = (content["end_angle"] - first_rad) / max(1, len(ranges) - 1)
    place = content.get("pose", {}).get("position", {})
    x_m, y_m = place.get("x", 0.0), place.get("y", 0.0)
    most_m = content.get("max_range", math.inf)
    name, sweep_s = content.get("name", ""), content.get("sweep_s", 0.0)
    return LidarScan(
        stamp_ns, x_m, y_m, first_rad, step_rad, most_m, ranges.tobytes(), name, sweep_s
    )


def notice(stamp_ns: int, content: Content) -> Notice:
    """Return a message of the topic `notice`, a `foxglove.Log`."""
    return Notice(stamp_ns, severity_of(content["level"]), content["message"])


RESTORED: Final[Mapping[str, Callable[[int, Content], Restored]]] = {
    "control": control_state,
    "navigation": navigation_state,
    "localisation": localisation_state,
    "lidar": lidar_scan,
    "notice": notice,
}
"""Makers of messages by topic, from a time of the robot's clock [ns] and the content."""


def particle_cloud(stamp_ns: int, content: Content) -> ParticleCloud:
    """Return a message of the topic `particles`."""
    return ParticleCloud(stamp_ns, packed_points(content, ("x", "y", "theta")))


def live_map(stamp_ns: int, content: Content) -> LiveMap:
    """Return a `foxglove.Grid` of the topics `map`, `live_map` or `costs`."""
    columns, stride, step = content["column_count"], content["row_stride"], content["cell_stride"]
    rows = np.frombuffer(b64decode(content["data"]), np.uint8).reshape(-1, stride)
    at = next(each["offset"] for each in content["fields"] if each["name"] == "occupancy")
    cells = rows[:, at : columns * step : step]
    place, turned = content["pose"]["position"], content["pose"]["orientation"]
    return LiveMap(
        stamp_ns,
        len(cells),
        columns,
        content["cell_size"]["x"],
        place["x"],
        place["y"],
        cells.tobytes(),
        2.0 * math.atan2(turned["z"], turned["w"]),
    )


def moving_things(content: Content) -> tuple[tuple[float, float, float, float, float], ...]:
    """Return the moving obstacles of a `foxglove.SceneUpdate`: x, y, vx, vy and radius [m, m/s]."""
    found = []
    for entity in content["entities"]:
        place = entity["cylinders"][0]["pose"]["position"]
        facts = {each["key"]: float(each["value"]) for each in entity["metadata"]}
        motion = facts["vx_m_s"], facts["vy_m_s"], facts["radius_m"]
        found.append((place["x"], place["y"], *motion))
    return tuple(found)


def body_outlines(content: Content) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Return the polygons of the body in a `foxglove.SceneUpdate` [m], without its nose.

    The nose is the last line; in logs of before that was so, a corner of the only one.
    """
    polygons = [
        [(each["x"], each["y"]) for each in line["points"]]
        for line in content["entities"][0]["lines"]
    ]
    if len(polygons) > 1:
        return tuple(map(tuple, polygons[:-1]))
    front_m = polygons[0][0][0]
    return (tuple(dict.fromkeys(each for each in polygons[0] if each[0] <= front_m)),)


def packed_points(content: Content, names: tuple[str, ...]) -> bytes:
    """Return fields of a `foxglove.PointCloud` as float32, point by point."""
    data, stride = b64decode(content["data"]), content["point_stride"]
    layout = {each["name"]: (_PACKED[each["type"]], each["offset"]) for each in content["fields"]}
    kind = np.dtype(
        {
            "names": names,
            "formats": [layout[each][0] for each in names],
            "offsets": [layout[each][1] for each in names],
            "itemsize": stride,
        }
    )
    points = np.frombuffer(data[: len(data) // stride * stride], kind)
    columns: NDArray[np.float32] = np.column_stack([points[each] for each in names])
    return columns.astype("<f4").tobytes()


def _with_pose(content: Content, name: str) -> dict[str, Any]:
    """Return the fields of a state together with those of its pose."""
    fields = dict(content)
    fields |= fields.pop(name, {})
    return fields


def _range_m(part: Content) -> float:
    """Return a range [m]; inf: nothing in reach, nan: no valid reading."""
    if part.get("out_of_range"):
        return math.inf
    return float(part.get("range_m", math.nan))


def _filled(kind: type[S], content: Content, stamp_ns: int) -> S:
    """Return a message from its available fields."""
    found: S = _reader(kind)({**content, "stamp_ns": stamp_ns})
    return found


@cache
def _reader(kind: Any) -> Callable[[Any], Any]:
    """Return the function that makes a value of a type from its JSON."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return _reader_of_struct(kind)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (present,) = (each for each in arguments if each is not type(None))
        inner = _reader(present)
        return lambda value: None if value is None else inner(value)
    if origin is tuple:
        of_item = _reader(arguments[0])
        return lambda value: tuple(map(of_item, value))
    if kind is bytes:
        return b64decode
    if kind is float:
        return lambda value: float(value) if isinstance(value, int) else value
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        known = {each.value: each for each in kind}
        return lambda value: known.get(value, value)  # another version has more of them
    return lambda value: value


def _reader_of_struct(kind: type[msgspec.Struct]) -> Callable[[Any], Any]:
    """Return the function that makes a struct from an object."""
    hints = get_type_hints(kind)
    fields = [
        (each.name, _reader(hints[each.name]), _missing(hints[each.name], each))
        for each in msgspec.structs.fields(kind)
    ]

    def read(content: Content) -> msgspec.Struct:
        values = (
            missing() if content.get(name) is None else inner(content[name])
            for name, inner, missing in fields
        )
        return kind(*values)

    return read


def _missing(kind: Any, field: msgspec.structs.FieldInfo) -> Callable[[], Any]:
    """Return the function that makes the value of a field that was not logged."""
    if kind is float:
        return lambda: math.nan
    if field.default is not msgspec.NODEFAULT:
        return lambda: field.default
    if field.default_factory is not msgspec.NODEFAULT:
        made: Callable[[], Any] = field.default_factory
        return made
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        inner = _reader(kind)
        return lambda: inner({})
    if get_origin(kind) in (Union, types.UnionType):
        return lambda: None
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return lambda: next(iter(kind))
    empty: Callable[[], Any] = get_origin(kind) or kind
    return empty
