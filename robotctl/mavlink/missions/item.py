"""An item of a MAVLink mission, as MISSION_ITEM_INT and MISSION_ITEM carry it."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink.command import Command
from robotctl.mavlink.frames import enu_from_ned
from robotctl.mavlink.globe import SCALE, Origin
from robotctl.messages.mavlink_port import Message

GLOBAL_FRAMES: Final = frozenset(
    {
        common.MAV_FRAME_GLOBAL,
        common.MAV_FRAME_GLOBAL_INT,
        common.MAV_FRAME_GLOBAL_RELATIVE_ALT,
        common.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        common.MAV_FRAME_GLOBAL_TERRAIN_ALT,
        common.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
    }
)
"""Latitude and longitude; the altitude, which they differ in, is none of a wheeled robot's."""
_LOCAL_SCALE: Final = 1e4
"""Units of MISSION_ITEM_INT's local x and y per metre."""
_MOST: Final = 2**31 - 1
"""Greatest int32."""


class MissionItem(NamedTuple):
    """One item; x and y are degrees in `GLOBAL_FRAMES`, else metres (north, east)."""

    command: int
    frame: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    autocontinue: bool = True

    @property
    def is_global(self) -> bool:
        """Whether it says latitude and longitude."""
        return self.frame in GLOBAL_FRAMES

    @property
    def scale(self) -> float:
        """Units of MISSION_ITEM_INT's x and y in one of its own."""
        return SCALE if self.is_global else _LOCAL_SCALE


def place_of(item: MissionItem, origin: Origin | None) -> tuple[float, float] | None:
    """Return x and y of an item in `world` [m]; None: its frame means nothing here."""
    if item.is_global:
        return None if origin is None else origin.to_world(item.x, item.y)
    if item.frame == common.MAV_FRAME_LOCAL_NED:
        return enu_from_ned(item.x, item.y)
    return (item.x, item.y) if item.frame == common.MAV_FRAME_LOCAL_ENU else None


def asked_place(command: Command, origin: Origin | None) -> tuple[float, float] | None:
    """Return x and y of a COMMAND_INT in `world` [m]; None: its frame means nothing here."""
    if command.frame is None:
        return None
    item = MissionItem(command.number, command.frame, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    x, y = (each / item.scale for each in command.params[4:6])
    return place_of(item._replace(x=x, y=y), origin)


def item_of(message: Message, hidden: int = 0) -> MissionItem:
    """Return the item of a MISSION_ITEM_INT or a MISSION_ITEM.

    `hidden` items come before the first one that the sender knows of.
    """
    params = (message.param1, message.param2, message.param3, message.param4)
    if message.command == common.MAV_CMD_DO_JUMP:
        params = (message.param1 + hidden, *params[1:])
    item = MissionItem(
        message.command, message.frame, params, 0.0, 0.0, message.z, bool(message.autocontinue)
    )
    scale = item.scale if message.get_msgId() == common.MAVLINK_MSG_ID_MISSION_ITEM_INT else 1.0
    return item._replace(x=message.x / scale, y=message.y / scale)


def message_of(
    item: MissionItem,
    seq: int,
    target: tuple[int, int],
    *,
    current: bool,
    whole: bool,
    kind: int,
    hidden: int = 0,
) -> Message:
    """Return MISSION_ITEM_INT (`whole`), or the older MISSION_ITEM, for a ground station.

    `hidden` items come before the first one that it knows of.
    """
    params = item.params
    if item.command == common.MAV_CMD_DO_JUMP:
        params = (params[0] - hidden, *params[1:])
    make = common.MAVLink_mission_item_int_message if whole else common.MAVLink_mission_item_message
    place = [_whole(each * item.scale) if whole else each for each in (item.x, item.y)]
    return make(
        *target,
        seq - hidden,
        item.frame,
        item.command,
        int(current),
        int(item.autocontinue),
        *params,
        *place,
        item.z if math.isfinite(item.z) else 0.0,
        kind,
    )


def _whole(value: float) -> int:
    """Return an int32; 0 for no number, which commands without a place may have."""
    return 0 if math.isnan(value) else round(min(max(value, -_MOST), _MOST))
