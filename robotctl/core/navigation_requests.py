"""Requests of other processes to navigation, for the planning layer, which knows no messages."""

from __future__ import annotations

from typing import Final, TypeAlias

from robotctl.messages.control import (
    ManualControl,
    NavigationRequest,
    PositionTarget,
    SetHome,
    SetMode,
    SetReverse,
    VelocityTarget,
)
from robotctl.messages.fence import EnableFence, SetFence, SetRally
from robotctl.messages.mission import (
    AbortMission,
    ExploreTarget,
    GoAhead,
    JumpToItem,
    MissionCommand,
    PlaceTarget,
)
from robotctl.messages.mode import Mode
from robotctl.messages.plans import SetZones
from robotctl.messages.requests import (
    REQUEST_LIFE_NS,
    AbortRequest,
    ExploreRequest,
    GoAheadRequest,
    HomeRequest,
    JumpRequest,
    ModeRequest,
    PlaceRequest,
    PositionRequest,
    Request,
    ReverseRequest,
    StickRequest,
    VelocityRequest,
)

_Simple: TypeAlias = (
    SetMode
    | VelocityTarget
    | PositionTarget
    | ManualControl
    | SetReverse
    | SetHome
    | ExploreTarget
    | PlaceTarget
    | GoAhead
    | JumpToItem
    | AbortMission
)
"""Requests that need no more than to be translated."""


_WITHOUT_WORDS: Final[dict[type, Request]] = {
    ExploreTarget: ExploreRequest(),
    GoAhead: GoAheadRequest(),
    AbortMission: AbortRequest(),
}
_DATED: Final = (
    SetMode
    | SetReverse
    | SetHome
    | PositionTarget
    | MissionCommand
    | SetFence
    | EnableFence
    | SetRally
    | SetZones
)
"""Requests that are not carried out once they are too old."""


def too_late(message: NavigationRequest, now_ns: int) -> bool:
    """Return whether a request waited too long to move the robot."""
    if isinstance(message, AbortMission) or (
        isinstance(message, SetMode) and message.mode is Mode.HOLD
    ):
        return False
    old = now_ns - message.stamp_ns > REQUEST_LIFE_NS
    return old and isinstance(message, _DATED)


def translated(message: _Simple) -> Request:
    """Translate a message for the planning layer, which knows none."""
    match message:
        case SetMode():
            return ModeRequest(message.mode, message.stamp_ns)
        case VelocityTarget():
            return VelocityRequest(
                message.expires_ns,
                message.v_m_s,
                message.omega_rad_s,
                message.heading_rad,
                message.vy_m_s,
                message.in_world,
            )
        case PositionTarget():
            return PositionRequest(message.x_m, message.y_m, message.heading_rad)
        case ManualControl():
            return StickRequest(message.expires_ns, message.forward, message.turn, message.sideways)
        case SetReverse():
            return ReverseRequest(message.reverse)
        case SetHome():
            return HomeRequest(message.x_m, message.y_m, message.theta_rad)
        case PlaceTarget():
            return PlaceRequest(message.place, message.start)
        case JumpToItem():
            return JumpRequest(message.item)
        case ExploreTarget() | GoAhead() | AbortMission():
            return _WITHOUT_WORDS[type(message)]
