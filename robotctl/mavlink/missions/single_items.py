"""Items of a mission that stand for themselves: home, and a place to drive to at once."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Context
from robotctl.mavlink.frames import ned_from_enu
from robotctl.mavlink.missions.item import MissionItem, item_of
from robotctl.mavlink.missions.translate import HOME, BadItem, bounded_place
from robotctl.mavlink.missions.uploads import GUIDED_ITEM
from robotctl.messages.control import Mode
from robotctl.messages.mavlink_port import Message, Peer, source


def hidden_items(context: Context) -> int:
    """Return how many items stations do not see: home, unless the personality lists it."""
    return 0 if context.personality.has_home_item else HOME


def home_item(context: Context) -> MissionItem:
    """Return where the robot started, in degrees where that can be said."""
    home, origin = context.home, context.origin
    command, params = common.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0)
    if origin is not None:
        place = origin.from_world(home.x_m, home.y_m)
        return MissionItem(command, common.MAV_FRAME_GLOBAL, params, *place, origin.altitude_m)
    north, east = ned_from_enu(home.x_m, home.y_m)
    return MissionItem(command, common.MAV_FRAME_LOCAL_NED, params, north, east, 0.0)


def guided_place(
    context: Context, message: Message, peer: Peer, now_ns: int
) -> tuple[int, str, tuple[float, float] | None]:
    """Return MAV_MISSION_RESULT, the objection to a place, and else the place in `world` [m]."""
    item = item_of(message)
    denied = int(common.MAV_MISSION_DENIED)
    if message.current != GUIDED_ITEM or item.command != common.MAV_CMD_NAV_WAYPOINT:
        return int(common.MAV_MISSION_UNSUPPORTED), "only a way-point is driven to", None
    if not context.is_armed(now_ns) or context.mode(now_ns) is not Mode.GUIDED:
        return denied, "arm first, in GUIDED", None
    if why := context.held_back.objection(peer, source(message), now_ns):
        return denied, why, None
    try:
        place = bounded_place(item, 0, context.origin)
    except BadItem as error:
        return error.result, error.why, None
    if why := context.fence_objection(*place, now_ns):
        return denied, why, None
    return int(common.MAV_MISSION_ACCEPTED), "", place
