"""How the states of the processes stand in the log: poses with their frames, ranges one by one.

A range that was measured is `range_m`; `out_of_range` says that nothing was there from here to as
far as the sensor sees. Without `range_m` and out of range there is no valid reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

from robotctl.runtime.estimation_messages import CameraView, LocalisationState
from robotctl.runtime.messages import ControlState
from robotctl.telemetry.log_schema import JsonSchema, plain, schema_of

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
    """Return a state of the control process, its sonars by name as far as there are names."""
    content: dict[str, Any] = plain(state)
    content.pop("sonar_m", None)
    content.pop("sonar_stamp_ns", None)
    content["T_odom_base"] = {key: content.pop(key) for key in _POSE}
    content["sonars"] = [
        {
            "name": sonar_names[index] if index < len(sonar_names) else str(index),
            "stamp_ns": stamp_ns,
            **_range(range_m),
        }
        for index, (range_m, stamp_ns) in enumerate(
            zip(state.sonar_m, state.sonar_stamp_ns, strict=True)
        )
    ]
    return content


def localisation_schema() -> JsonSchema:
    """Return the schema of `localisation_content`."""
    return _replaced(schema_of(LocalisationState), _POSE, T_world_odom=_POSE_SCHEMA)


def localisation_content(state: LocalisationState) -> dict[str, Any]:
    """Return what the localiser believes; the covariance is that of `base` in `world`."""
    content: dict[str, Any] = plain(state)
    content["T_world_odom"] = {key: content.pop(key) for key in _POSE}
    return content


def camera_schema() -> JsonSchema:
    """Return the schema of `camera_content`."""
    beam = {"angle_rad": _NUMBER, **_RANGE, "sigma_m": _NUMBER, "nearest_m": _NUMBER}
    return _replaced(
        schema_of(CameraView), _BEAMS, beams=_list_of(beam, "angle_rad", "out_of_range")
    )


def camera_content(view: CameraView) -> dict[str, Any]:
    """Return what the camera saw, beam by beam."""
    content: dict[str, Any] = plain(view)
    for key in _BEAMS:
        content.pop(key, None)
    content["beams"] = [
        {
            "angle_rad": angle_rad,
            **_range(range_m),
            **_finite("sigma_m", sigma_m),
            **_finite("nearest_m", nearest_m),
        }
        for angle_rad, range_m, sigma_m, nearest_m in zip(
            view.angles_rad, view.ranges_m, view.sigmas_m, view.nearest_m, strict=True
        )
    ]
    return content


def _range(range_m: float) -> dict[str, object]:
    """Return how a range is written [m]; inf: out of range, nan: no valid reading."""
    if math.isfinite(range_m):
        return {"range_m": range_m, "out_of_range": False}
    return {"out_of_range": range_m == math.inf}


def _finite(name: str, value: float) -> dict[str, object]:
    """Return a number by its name; nothing where it is not finite."""
    return {name: value} if math.isfinite(value) else {}


def _list_of(properties: dict[str, JsonSchema], *required: str) -> JsonSchema:
    """Return the schema of a list of objects."""
    item = {"type": "object", "properties": properties, "required": list(required)}
    return {"type": "array", "items": item}


def _replaced(schema: JsonSchema, dropped: Iterable[str], **added: JsonSchema) -> JsonSchema:
    """Return the schema of an object with some properties in place of others."""
    kept = {name: part for name, part in schema["properties"].items() if name not in dropped}
    required = [name for name in schema["required"] if name in kept]
    return {**schema, "properties": {**kept, **added}, "required": [*required, *added]}
