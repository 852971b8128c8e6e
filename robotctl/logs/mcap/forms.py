"""Form of the processes' states in the log: poses with their frames, ranges one by one.

A measured range is `range_m`; `out_of_range` means nothing within the sensor's range. Without
either there is no valid reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

from robotctl.logs.mcap.schema import JsonSchema, plain, schema_of
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import CameraView, LocalisationState

_NUMBER: Final[JsonSchema] = {"type": "number"}
_POSE: Final = ("x_m", "y_m", "theta_rad")
_POSE_SCHEMA: Final[JsonSchema] = {
    "type": "object",
    "properties": dict.fromkeys(_POSE, _NUMBER),
    "required": list(_POSE),
}
_RANGE: Final[dict[str, JsonSchema]] = {"range_m": _NUMBER, "out_of_range": {"type": "boolean"}}
_BEAMS: Final = ("angles_rad", "ranges_m", "sigmas_m", "nearest_m")


def control_schema() -> JsonSchema:
    """Return the schema of `control_content`."""
    sonar = {
        "name": {"type": "string"},
        "stamp_ns": {"type": "integer"},
        **_RANGE,
    }
    return _replaced(
        schema_of(ControlState),
        (*_POSE, "sonar_m", "sonar_stamp_ns"),
        T_odom_base=_POSE_SCHEMA,
        sonars=_list_of(sonar, "name", "stamp_ns", "out_of_range"),
    )


def control_content(state: ControlState, sonar_names: Sequence[str]) -> dict[str, Any]:
    """Return a state of the control process, its sonars by name; without names by number."""
    content: dict[str, Any] = plain(state)
    content.pop("sonar_m", None)
    content.pop("sonar_stamp_ns", None)
    content["T_odom_base"] = {key: content.pop(key) for key in _POSE}
    count = len(state.sonar_m)
    names = sonar_names if len(sonar_names) == count else map(str, range(count))
    content["sonars"] = list(map(_sonar, names, state.sonar_stamp_ns, state.sonar_m))
    return content


def localisation_schema() -> JsonSchema:
    """Return the schema of `localisation_content`."""
    return _replaced(schema_of(LocalisationState), _POSE, T_world_odom=_POSE_SCHEMA)


def localisation_content(state: LocalisationState) -> dict[str, Any]:
    """Return the localiser's estimate; the covariance is that of `base` in `world`."""
    content: dict[str, Any] = plain(state)
    content["T_world_odom"] = {key: content.pop(key) for key in _POSE}
    return content


def camera_schema() -> JsonSchema:
    """Return the schema of `camera_content`."""
    beam = {
        "angle_rad": _NUMBER,
        **_RANGE,
        "sigma_m": _NUMBER,
        "nearest_m": _NUMBER,
    }
    return _replaced(
        schema_of(CameraView),
        (*_BEAMS, "features"),
        beams=_list_of(beam, "angle_rad", "out_of_range"),
    )


def camera_content(view: CameraView) -> dict[str, Any]:
    """Return the camera's ranges, beam by beam, without its features, which are large."""
    content: dict[str, Any] = plain(view)
    for key in (*_BEAMS, "features"):
        content.pop(key, None)
    content["beams"] = list(
        map(_beam, view.angles_rad, view.ranges_m, view.sigmas_m, view.nearest_m)
    )
    return content


def _sonar(name: str, stamp_ns: int, range_m: float) -> dict[str, object]:
    """Return one sonar's range [m]; inf: out of range, nan: no valid reading."""
    sonar: dict[str, object] = {
        "name": name,
        "stamp_ns": stamp_ns,
        "out_of_range": range_m == math.inf,
    }
    if math.isfinite(range_m):
        sonar["range_m"] = range_m
    return sonar


def _beam(angle_rad: float, range_m: float, sigma_m: float, nearest_m: float) -> dict[str, object]:
    """Return one beam of the camera, the range as in `_sonar`."""
    beam: dict[str, object] = {"angle_rad": angle_rad, "out_of_range": range_m == math.inf}
    if math.isfinite(range_m):
        beam["range_m"] = range_m
    if math.isfinite(sigma_m):
        beam["sigma_m"] = sigma_m
    if math.isfinite(nearest_m):
        beam["nearest_m"] = nearest_m
    return beam


def _list_of(properties: dict[str, JsonSchema], *required: str) -> JsonSchema:
    """Return the schema of a list of objects."""
    item = {"type": "object", "properties": properties, "required": list(required)}
    return {"type": "array", "items": item}


def _replaced(schema: JsonSchema, dropped: Iterable[str], **added: JsonSchema) -> JsonSchema:
    """Return the schema of an object with some properties replaced."""
    kept = {name: part for name, part in schema["properties"].items() if name not in dropped}
    required = [name for name in schema["required"] if name in kept]
    return {**schema, "properties": {**kept, **added}, "required": [*required, *added]}
