"""A mission file of ours as MAVLink items: for missions that did not come over MAVLink."""

from __future__ import annotations

import math
import tomllib
from typing import Any, Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.frames import ned_from_enu, yaw_ned_from_theta
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.file import NOTHING, MissionPlan, UploadedMission, read_mission_file
from robotctl.mavlink.missions.item import MissionItem

_NONE: Final = (0.0, 0.0, 0.0, 0.0)
_OWN_SPEED: Final = -1.0
"""Speed of DO_CHANGE_SPEED that restores the robot's own."""
_FLOW: Final = {"jump": "to", "repeat": "first"}
"""Kinds that say which item is next, and the key that names it."""
_DRIVES: Final = frozenset({"goto", "straight_to", "drive", "circle"})
_NORTH_DEG: Final = 360.0
"""Yaw that means north [deg]: 0 would mean any heading."""


class _Unsaid(Exception):  # noqa: N818 - not an error: MAVLink has no word for it
    """An item that MAVLink cannot express."""


def plan_of_file(content: bytes, origin: Origin | None) -> MissionPlan:
    """Return what stations are told of a mission file; no items if MAVLink cannot say it.

    The items as they came over MAVLink; else way-points, circles, delays, speeds, and at most one
    jump or repeat, since those of MAVLink count otherwise within each other.
    """
    kept = read_mission_file(content)
    if kept is not None:
        return MissionPlan(kept, content)
    try:
        tables = tomllib.loads(content.decode("utf-8-sig"))["item"]
    except (ValueError, KeyError, RecursionError):  # damaged
        return MissionPlan()
    try:
        return MissionPlan(_Writer(origin).write(tables), content)
    except (_Unsaid, ValueError, KeyError, TypeError):
        return MissionPlan(NOTHING, content)


class _Writer:
    """Goes through the items of a file, of which navigation has taken each."""

    def __init__(self, origin: Origin | None) -> None:
        self._origin = origin
        home = MissionItem(common.MAV_CMD_NAV_WAYPOINT, common.MAV_FRAME_LOCAL_NED, _NONE, 0, 0, 0)
        self._items = [home]
        self._speed_m_s = _OWN_SPEED

    def write(self, tables: list[dict[str, Any]]) -> UploadedMission:
        """Return the items, and for each of the file the number of the first that it became."""
        if sum(each["kind"] in _FLOW for each in tables) > 1:
            raise _Unsaid
        sources = []
        for table in tables:
            self._speed(table)
            sources.append(len(self._items))
            self._item(table)
        for table, seq in zip(tables, sources, strict=True):
            if (key := _FLOW.get(table["kind"])) is not None:
                target = table.get(key, 1)
                names = [each.get("name", "") for each in tables]
                number = names.index(target) if isinstance(target, str) else target - 1
                params = self._items[seq].params
                params = (float(sources[number]), *params[1:])
                self._items[seq] = self._items[seq]._replace(params=params)
        return UploadedMission(tuple(self._items), tuple(sources), None)

    def _item(self, table: dict[str, Any]) -> None:
        """Write one item; where a jump leads is filled in later."""
        match table:
            case {"kind": "goto" | "straight_to", "x_m": x_m, "y_m": y_m}:
                self._place(x_m, y_m, table.get("heading_deg"))
            case {"kind": "drive", "waypoints": points}:
                for x_m, y_m in points:
                    self._place(x_m, y_m, None)
            case {"kind": "circle", "x_m": x_m, "y_m": y_m, "radius_m": radius_m}:
                clockwise_m = radius_m if table.get("side") == "right" else -radius_m
                params = (float(table.get("turns", 1.0)), 0.0, float(clockwise_m), 0.0)
                self._at(x_m, y_m, common.MAV_CMD_NAV_LOITER_TURNS, params)
            case {"kind": "wait", "duration_s": seconds}:
                self._plain(common.MAV_CMD_NAV_DELAY, float(seconds))
            case {"kind": "jump"}:
                self._plain(common.MAV_CMD_DO_JUMP, 0.0, float(table.get("times", -1)))
            case {"kind": "repeat"}:
                # `times` rounds in all: the way back is taken once less.
                self._plain(common.MAV_CMD_DO_JUMP, 0.0, float(table.get("times", 0) - 1))
            case _:
                raise _Unsaid

    def _speed(self, table: dict[str, Any]) -> None:
        """Write the speed of a table that drives, if it is another one."""
        if table["kind"] not in _DRIVES:
            return
        speed_m_s = table.get("speed_m_s", _OWN_SPEED)
        if speed_m_s != self._speed_m_s:
            self._speed_m_s = speed_m_s
            self._plain(common.MAV_CMD_DO_CHANGE_SPEED, 1.0, float(speed_m_s))

    def _plain(self, command: int, *params: float) -> None:
        a, b, c, d = (*params, *_NONE[len(params) :])
        self._items.append(MissionItem(command, common.MAV_FRAME_MISSION, (a, b, c, d), 0, 0, 0))

    def _place(self, x_m: float, y_m: float, heading_deg: float | None) -> None:
        yaw = 0.0
        if heading_deg is not None:
            yaw = math.degrees(yaw_ned_from_theta(math.radians(heading_deg))) or _NORTH_DEG
        self._at(x_m, y_m, common.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, yaw))

    def _at(
        self, x_m: float, y_m: float, command: int, params: tuple[float, float, float, float]
    ) -> None:
        origin = self._origin
        if origin is None:
            north, east = ned_from_enu(x_m, y_m)
            item = MissionItem(command, common.MAV_FRAME_LOCAL_NED, params, north, east, 0.0)
        else:
            frame = common.MAV_FRAME_GLOBAL_RELATIVE_ALT
            item = MissionItem(command, frame, params, *origin.from_world(x_m, y_m), 0.0)
        self._items.append(item)
