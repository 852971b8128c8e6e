"""Messages of the robot's processes read back from a log, as far as JSON keeps them."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from typing import Any, Final, TypeAlias

import msgspec

from robotctl.logs.formats.robotctl_messages import logged_scan
from robotctl.logs.mcap.foxglove import severity_of
from robotctl.logs.mcap.schema import restored
from robotctl.messages.control import ControlState, NavigationState, Notice
from robotctl.messages.estimation import LidarScan, LocalisationState

Restored: TypeAlias = ControlState | NavigationState | LocalisationState | LidarScan | Notice
"""A message that is read back."""


def restored_message(topic: str, data: bytes, stamp_ns: int) -> Restored | None:
    """Return a message of a log; None for topics that are pictures.

    Parameters
    ----------
    topic, data
        Of the log.
    stamp_ns
        Time by the robot's clock, for messages that do not tell it [ns].

    Raises
    ------
    msgspec.DecodeError, LookupError, TypeError, ValueError
        If it is no message of this topic.
    """
    if topic == "lidar":
        return _scan(data, stamp_ns)
    read = _KINDS.get(topic)
    return None if read is None else read(msgspec.json.decode(data), stamp_ns)


def _control(content: dict[str, Any], _stamp_ns: int) -> ControlState:
    """Return a state; see `control_content`."""
    content |= content.pop("T_odom_base")
    sonars = content.pop("sonars")
    content["sonar_m"] = [
        math.inf if each["out_of_range"] else each.get("range_m", math.nan) for each in sonars
    ]
    content["sonar_stamp_ns"] = [each["stamp_ns"] for each in sonars]
    state: ControlState = restored(ControlState, content)
    return state


def _localisation(content: dict[str, Any], _stamp_ns: int) -> LocalisationState:
    content |= content.pop("T_world_odom")
    state: LocalisationState = restored(LocalisationState, content)
    return state


def _navigation(content: dict[str, Any], _stamp_ns: int) -> NavigationState:
    state: NavigationState = restored(NavigationState, content)
    return state


def _notice(content: dict[str, Any], stamp_ns: int) -> Notice:
    return Notice(stamp_ns, severity_of(content["level"]), content["message"])


_KINDS: Final[dict[str, Callable[[dict[str, Any], int], Restored]]] = {
    "control": _control,
    "localisation": _localisation,
    "navigation": _navigation,
    "notice": _notice,
}


def _scan(data: bytes, stamp_ns: int) -> LidarScan:
    scan = logged_scan(data)
    steps = max(len(scan.ranges_m) - 1, 1)
    return LidarScan(
        stamp_ns,
        scan.x_m,
        scan.y_m,
        scan.first_rad,
        (scan.last_rad - scan.first_rad) / steps,
        scan.max_range_m,
        array("f", scan.ranges_m).tobytes(),
    )
