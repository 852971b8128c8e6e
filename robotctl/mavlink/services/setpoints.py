"""SET_POSITION_TARGET_LOCAL_NED: velocities and positions from a ground station.

| type_mask uses | frame | request |
|---|---|---|
| vx, may use vy = 0 | BODY_NED, BODY_FRD, | drive at vx, turning at yaw_rate if used |
|  | BODY_OFFSET_NED | |
| vx and vy, yaw_rate | LOCAL_NED | drive at the part of the velocity along the heading, and turn |
| vx and vy | LOCAL_NED | turn towards the velocity, or towards yaw if used, and drive along it;
|  | | a drive-and-steer robot turns in a bend, forwards |
| x and y | LOCAL_NED | drive to the point; yaw and yaw_rate do not matter |

Velocities and positions count in GUIDED alone, and positions only while the robot is armed: one
that was sent before has to be sent again.

A set-point counts from when it was sent, as far as `sender_clock` can tell from `time_boot_ms`;
where it cannot, from its arrival. One that is void by then, or a position older than requests live,
is refused.

z, vz and their bits do not matter to a rover, nor does FORCE_SET without accelerations, which many
programs set by mistake (0x0FC7). All else (accelerations or forces, position together with
velocity, half a vector, yaw together with yaw_rate, other frames, numbers that are not finite, a
point 1000 km away, a sideways velocity) is refused, counted by reason, and said once in a while; so
are SET_POSITION_TARGET_GLOBAL_INT and SET_ATTITUDE_TARGET.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import ClassVar, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.context import Context
from robotctl.mavlink.guards.transport_delay import SenderClocks
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import PositionTarget, VelocityTarget
from robotctl.messages.mavlink_port import Message, Peer, source
from robotctl.messages.requests import FARTHEST_M, REQUEST_LIFE_NS

FOLLOWED: int = common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
BODY_FRAMES = frozenset(
    {common.MAV_FRAME_BODY_NED, common.MAV_FRAME_BODY_FRD, common.MAV_FRAME_BODY_OFFSET_NED}
)
"""An offset is one of positions: velocities are the body's in all three."""
LOCAL_NED: int = common.MAV_FRAME_LOCAL_NED

SAY_AGAIN_NS = 30_000_000_000


class Used(NamedTuple):
    """The fields that a type_mask does not ignore; vectors need both horizontal parts."""

    position: int
    velocity: int
    acceleration: bool
    yaw: bool
    yaw_rate: bool


class Wanted(NamedTuple):
    """A velocity of `base` [m/s, rad/s], or one along a direction of `world` [rad]."""

    v_m_s: float
    omega_rad_s: float = 0.0
    heading_rad: float | None = None
    """The navigator turns to it, which knows the remaining angle at each step."""


class Refused(ValueError):  # noqa: N818 - says what happened to the set-point
    """A set-point that cannot be followed; the text is the reason."""


class Setpoints(Microservice):
    """Turns valid set-points into requests; velocities expire.

    `refused` counts by reason.
    """

    handles = frozenset(
        {
            FOLLOWED,
            common.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT,
            common.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        }
    )
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._timeout_ns = round(context.config.setpoint_timeout_s * 1e9)
        self._clocks = SenderClocks()
        self.refused: Counter[str] = Counter()
        self._said_ns: dict[str, int] = {}

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take one set-point."""
        try:
            if message.get_msgId() != FOLLOWED:
                raise Refused(f"{message.get_type()}: only SET_POSITION_TARGET_LOCAL_NED counts")
            stream = (peer, source(message))
            late_ns = self._clocks.late_ns(stream, message.time_boot_ms, now_ns)
            self._follow(message, late_ns, now_ns)
        except Refused as refused:
            reason = str(refused)
            self.refused[reason] += 1
            if now_ns >= self._said_ns.get(reason, now_ns):
                self._said_ns[reason] = now_ns + SAY_AGAIN_NS
                self._context.say(now_ns, f"Setpoint: {reason}")

    def _follow(self, message: Message, late_ns: int, now_ns: int) -> None:
        used = used_parts(message.type_mask)
        life_ns = REQUEST_LIFE_NS if used.position else self._timeout_ns
        if late_ns >= life_ns:
            raise Refused(f"came {life_ns / 1e9:g} s late or later")
        sent_ns = now_ns - late_ns
        if used.position:
            self._context.requests.append(position_target(message, used, sent_ns))
            return
        context = self._context
        heading_rad = context.heading_rad(now_ns)
        wanted = wanted_velocity(message, used, heading_rad)
        expires_ns = sent_ns + self._timeout_ns
        self._context.requests.append(VelocityTarget(sent_ns, expires_ns, *wanted))


def used_parts(mask: int) -> Used:
    """Read a type_mask.

    Raises
    ------
    Refused
        If it contradicts itself or asks for what a rover does not follow.
    """
    used = Used(
        position=2 - (mask & 1) - (mask >> 1 & 1),
        velocity=2 - (mask >> 3 & 1) - (mask >> 4 & 1),
        acceleration=mask & 0x1C0 != 0x1C0,
        yaw=not mask & common.POSITION_TARGET_TYPEMASK_YAW_IGNORE,
        yaw_rate=not mask & common.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
    )
    if used.acceleration:
        raise Refused("accelerations are not followed")
    if used.position and used.velocity:
        raise Refused("position and velocity together")
    if used.position == 1:
        raise Refused("half a position")
    if not used.position and not used.velocity:
        raise Refused("neither position nor velocity")
    return used


def position_target(message: Message, used: Used, sent_ns: int) -> PositionTarget:  # noqa: ARG001
    """Return the point of `world` to drive to.

    Raises
    ------
    Refused
        If the frame or a number is wrong, or the point is where the navigator does not go.
    """
    if message.coordinate_frame != LOCAL_NED:
        raise Refused(f"position frame {message.coordinate_frame} is not LOCAL_NED")
    _check_finite(message.x, message.y)
    if max(abs(message.x), abs(message.y)) >= FARTHEST_M:
        raise Refused(f"position {FARTHEST_M / 1e3:g} km away or farther")
    point = frames.enu_from_ned(message.x, message.y)
    return PositionTarget(sent_ns, point.x, point.y)


def wanted_velocity(message: Message, used: Used, theta_rad: float | None) -> Wanted:
    """Return the request of a velocity set-point.

    Parameters
    ----------
    message : SET_POSITION_TARGET_LOCAL_NED
        The set-point.
    used : Used
        Its type_mask.
    theta_rad : float or None
        Present heading in `world` [rad]; only a velocity in LOCAL_NED other than zero needs it.

    Raises
    ------
    Refused
        If the frame, a number or the combination is wrong, or the heading is not known.
    """
    if used.yaw and used.yaw_rate:
        raise Refused("yaw and yaw rate together")
    if used.yaw_rate:
        _check_finite(message.yaw_rate)
    if message.coordinate_frame in BODY_FRAMES:
        return _body_velocity(message, used)
    if message.coordinate_frame != LOCAL_NED:
        raise Refused(f"velocity frame {message.coordinate_frame} is not body or local")
    return _local_velocity(message, used, theta_rad)


def _body_velocity(message: Message, used: Used) -> Wanted:
    if used.yaw:
        raise Refused("yaw with a velocity of the body")
    if message.type_mask & common.POSITION_TARGET_TYPEMASK_VX_IGNORE:
        raise Refused("half a velocity")
    _check_finite(message.vx)
    if used.velocity == 2:
        _check_finite(message.vy)
        if message.vy != 0.0:
            raise Refused("sideways velocity")
    omega_rad_s = frames.omega_from_yaw_rate_frd(message.yaw_rate) if used.yaw_rate else 0.0
    return Wanted(message.vx, omega_rad_s)


def _local_velocity(message: Message, used: Used, theta_rad: float | None) -> Wanted:
    if used.velocity != 2:
        raise Refused("half a velocity")
    _check_finite(message.vx, message.vy)
    velocity = frames.enu_from_ned(message.vx, message.vy)
    if velocity == (0.0, 0.0) and not used.yaw:
        return Wanted(
            0.0, frames.omega_from_yaw_rate_frd(message.yaw_rate) if used.yaw_rate else 0.0
        )
    if theta_rad is None:
        raise Refused("local velocity, but heading not known")
    if used.yaw_rate:
        along = velocity.x * math.cos(theta_rad) + velocity.y * math.sin(theta_rad)
        return Wanted(along, frames.omega_from_yaw_rate_frd(message.yaw_rate))
    if used.yaw:
        _check_finite(message.yaw)
        direction_rad = frames.theta_from_yaw_ned(message.yaw)
    else:
        direction_rad = math.atan2(velocity.y, velocity.x)
    along = velocity.x * math.cos(direction_rad) + velocity.y * math.sin(direction_rad)
    return Wanted(along, heading_rad=direction_rad)


def _check_finite(*values: float) -> None:
    if not all(math.isfinite(value) for value in values):
        raise Refused("a number that is not finite")
