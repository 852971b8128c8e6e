"""SET_POSITION_TARGET_LOCAL_NED: velocities and positions from a ground station.

| type_mask uses | frame | request |
|---|---|---|
| vx, may use vy = 0 | BODY_NED, BODY_FRD, | drive at vx, turning at yaw_rate if used |
|  | BODY_OFFSET_NED | |
| vx and vy, yaw_rate | LOCAL_NED, | drive at the part of the velocity along the heading, and turn |
|  | LOCAL_OFFSET_NED | |
| vx and vy | the same | turn towards the velocity, or towards yaw if used, and drive along it;
|  | | a drive-and-steer robot turns in a bend, forwards |
| x and y | LOCAL_NED | drive to the point; yaw and yaw_rate do not matter |
| x and y | LOCAL_OFFSET_NED | drive so far north and east from here |
| x and y | BODY_NED, | drive so far ahead and to the right from here |
|  | BODY_OFFSET_NED | |

A holonomic robot takes velocities as they are: vy of the body, and vx and vy of LOCAL_NED whatever
its heading, while it turns at yaw_rate or to yaw if used, and otherwise keeps its heading.

The frames are those of ArduRover's `handle_set_position_target_local_ned`. Velocities and positions
count in GUIDED alone, and positions only while the robot is armed: one that was sent before has to
be sent again. That such a one is not followed is said, with what is missing.

A set-point counts from when it was sent, as far as `transport_delay` can tell from `time_boot_ms`;
where it cannot, from its arrival. One that is void by then, or a position older than requests live,
is refused. A velocity is void after `setpoint_timeout_s`, and of a sender that sends at 5 Hz or
more after `FAST_LIFE_NS`.

z, vz and their bits do not matter to a rover, nor does FORCE_SET without accelerations, which many
programs set by mistake (0x0FC7). All else (accelerations or forces, position together with
velocity, half a vector, yaw together with yaw_rate, other frames, numbers that are not finite, a
point 1000 km away, a sideways velocity of a robot that is not holonomic) is refused, counted by
reason, and said once in a while; so is SET_ATTITUDE_TARGET.

SET_POSITION_TARGET_GLOBAL_INT counts as one in LOCAL_NED once the map has an origin on the globe.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import ClassVar, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.mavlink import frames
from robotctl.mavlink.context import TRANSPORT_NS, Context
from robotctl.mavlink.globe import SCALE, Origin
from robotctl.mavlink.guards.rhythm import Rhythm
from robotctl.mavlink.guards.transport_delay import SenderClocks
from robotctl.mavlink.missions.item import GLOBAL_FRAMES
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, PositionTarget, VelocityTarget
from robotctl.messages.mavlink_port import Address, Message, Peer, source
from robotctl.messages.requests import FARTHEST_M, REQUEST_LIFE_NS
from robotctl.model.geometry.se2 import SE2
from robotctl.safety.state_machine import POWERED

FOLLOWED: int = common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
GLOBAL: int = common.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT
BODY_FRAMES = frozenset(
    {common.MAV_FRAME_BODY_NED, common.MAV_FRAME_BODY_FRD, common.MAV_FRAME_BODY_OFFSET_NED}
)
"""An offset is one of positions: velocities are the body's in all three."""
LOCAL_NED: int = common.MAV_FRAME_LOCAL_NED
OFFSET_NED: int = common.MAV_FRAME_LOCAL_OFFSET_NED
LOCAL_FRAMES = frozenset({LOCAL_NED, OFFSET_NED})
"""Both have the axes of `world`; an offset is one of positions."""
POSITION_FRAMES = frozenset(
    {LOCAL_NED, OFFSET_NED, common.MAV_FRAME_BODY_NED, common.MAV_FRAME_BODY_OFFSET_NED}
)

FAST_LIFE_NS = 300_000_000
"""Maximum time for which a velocity from a sender of 5 Hz or more counts [ns]."""

SAY_AGAIN_NS = 30_000_000_000
"""Interval after which an unchanged objection is said again [ns]."""

UNHEEDED_NS = 300_000_000
"""Time for which set-points sent along with a request for GUIDED, or to arm, go unanswered [ns]."""


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
    """Heading that the navigator turns to: it knows the remaining angle at each step."""
    vy_m_s: float = 0.0
    in_world: bool = False
    """Whether both velocities are along x and y of `world`."""


class Refused(ValueError):  # noqa: N818 - says what happened to the set-point
    """A set-point that cannot be followed; the text is the reason."""


class Setpoints(Microservice):
    """Turns valid set-points into requests; velocities expire.

    `refused` counts by reason.
    """

    handles = frozenset(
        {
            FOLLOWED,
            GLOBAL,
            common.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET,
        }
    )
    capabilities: ClassVar[int] = (
        common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    )

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._clocks = SenderClocks()
        self._rhythm = Rhythm()
        self.refused: Counter[str] = Counter()
        self._said_ns: dict[str, int] = {}
        self._unheeded_ns: int | None = None
        """When a set-point came that the robot does not follow [ns]."""

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take one set-point."""
        stream = (peer, source(message))
        try:
            if message.get_msgId() == GLOBAL:
                message = _as_local(message, self._context.origin)
            elif message.get_msgId() != FOLLOWED:
                raise Refused(f"{message.get_type()}: only SET_POSITION_TARGET counts")
            late_ns = self._clocks.late_ns(stream, message.time_boot_ms, now_ns)
            self._follow(message, stream, late_ns, now_ns)
            if self._unheeded_ns is None and self._missing(now_ns):
                self._unheeded_ns = now_ns
        except Refused as refused:
            reason = str(refused)
            self.refused[reason] += 1
            self._say(reason, now_ns)

    def step(self, now_ns: int) -> None:
        """Say what is missing where set-points move nothing."""
        if self._unheeded_ns is None or now_ns - self._unheeded_ns < UNHEEDED_NS:
            return
        self._unheeded_ns = None
        if missing := self._missing(now_ns):
            self._say(f"not followed: {missing}", now_ns)

    def _missing(self, now_ns: int) -> str:
        """Return why set-points move nothing now, empty if they do."""
        mode, control = self._context.mode(now_ns), self._context.fresh_control(now_ns)
        if mode is not Mode.GUIDED:
            return f"mode {mode.name}, not GUIDED"
        if control is None:
            return "control is silent"
        if control.state not in POWERED:
            return f"not armed ({control.state.name})"
        return ""

    def _say(self, reason: str, now_ns: int) -> None:
        """Say something once in a while."""
        if now_ns >= self._said_ns.get(reason, now_ns):
            self._said_ns[reason] = now_ns + SAY_AGAIN_NS
            self._context.say(now_ns, f"Setpoint: {reason}")

    def _follow(
        self, message: Message, stream: tuple[Peer, Address], late_ns: int, now_ns: int
    ) -> None:
        used = used_parts(message.type_mask)
        context, sent_ns = self._context, now_ns - late_ns
        life_ns = REQUEST_LIFE_NS if used.position else self._velocity_life_ns(stream, sent_ns)
        if late_ns >= life_ns:
            raise Refused(f"came {life_ns / 1e9:g} s late or later")
        pose = context.known_pose(now_ns)
        if used.position:
            target = position_target(message, pose, sent_ns)
            if context.fence_objection(target.x_m, target.y_m, now_ns):
                raise Refused("a position beyond the fence")
            context.requests.append(target)
            return
        theta_rad = None if pose is None else pose.theta_rad
        holonomic = context.robot.holonomic
        wanted = wanted_velocity(message, used, theta_rad, holonomic=holonomic)
        context.requests.append(VelocityTarget(sent_ns, sent_ns + life_ns, *wanted))

    def _velocity_life_ns(self, stream: tuple[Peer, Address], sent_ns: int) -> int:
        """Return how long a velocity counts from when it was sent [ns]."""
        life_ns = self._context.setpoint_life_ns
        if self._rhythm.is_fast(stream, sent_ns):
            return min(life_ns, FAST_LIFE_NS - TRANSPORT_NS)
        return life_ns


def _as_local(message: Message, origin: Origin | None) -> Message:
    """Return a SET_POSITION_TARGET_GLOBAL_INT as one in LOCAL_NED.

    Raises
    ------
    Refused
        If nobody has said where the map lies on the globe, or its frame is none of the globe.
    """
    if message.coordinate_frame not in GLOBAL_FRAMES:
        raise Refused(f"frame {message.coordinate_frame} of a position on the globe")
    if origin is None:
        raise Refused("a position on the globe, but the map has no origin there")
    x_m, y_m = origin.to_world(message.lat_int / SCALE, message.lon_int / SCALE)
    place = frames.ned_from_enu(x_m, y_m)
    return common.MAVLink_set_position_target_local_ned_message(
        message.time_boot_ms, message.target_system, message.target_component, LOCAL_NED,
        message.type_mask, *place, 0.0, message.vx, message.vy, message.vz,
        message.afx, message.afy, message.afz, message.yaw, message.yaw_rate,
    )  # fmt: skip


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


def position_target(message: Message, pose: SE2 | None, sent_ns: int) -> PositionTarget:
    """Return the point of `world` to drive to.

    Parameters
    ----------
    message : SET_POSITION_TARGET_LOCAL_NED
        The set-point.
    pose : SE2 or None
        `base` in `world`; only offsets need it.
    sent_ns : int
        When it was sent [ns].

    Raises
    ------
    Refused
        If the frame or a number is wrong, the point is where the navigator does not go, or an
        offset is from a place that is not known.
    """
    frame = message.coordinate_frame
    if frame not in POSITION_FRAMES:
        allowed = ", ".join(str(each) for each in sorted(POSITION_FRAMES))
        raise Refused(f"position frame {frame}: allowed {allowed}")
    _check_finite(message.x, message.y)
    if max(abs(message.x), abs(message.y)) >= FARTHEST_M:
        raise Refused(f"position {FARTHEST_M / 1e3:g} km away or farther")
    if frame == LOCAL_NED:
        return PositionTarget(sent_ns, *frames.enu_from_ned(message.x, message.y))
    if pose is None:
        raise Refused("an offset, but the place is not known")
    if frame == OFFSET_NED:
        east, north = frames.enu_from_ned(message.x, message.y)
        return PositionTarget(sent_ns, pose.x_m + east, pose.y_m + north)
    point = pose @ SE2(*frames.base_from_frd(message.x, message.y))
    return PositionTarget(sent_ns, point.x_m, point.y_m)


def wanted_velocity(
    message: Message, used: Used, theta_rad: float | None, *, holonomic: bool = False
) -> Wanted:
    """Return the request of a velocity set-point.

    Parameters
    ----------
    message : SET_POSITION_TARGET_LOCAL_NED
        The set-point.
    used : Used
        Its type_mask.
    theta_rad : float or None
        Present heading in `world` [rad]; only a local velocity other than zero needs it.
    holonomic : bool
        Whether the robot moves sideways, too.

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
        return _body_velocity(message, used, holonomic=holonomic)
    if message.coordinate_frame not in LOCAL_FRAMES:
        raise Refused(f"velocity frame {message.coordinate_frame} is not body or local")
    return _local_velocity(message, used, theta_rad, holonomic=holonomic)


def _body_velocity(message: Message, used: Used, *, holonomic: bool) -> Wanted:
    if used.yaw:
        raise Refused("yaw with a velocity of the body")
    if message.type_mask & common.POSITION_TARGET_TYPEMASK_VX_IGNORE:
        raise Refused("half a velocity")
    right = message.vy if used.velocity == 2 else 0.0
    _check_finite(message.vx, right)
    if right != 0.0 and not holonomic:
        raise Refused("sideways velocity")
    v_m_s, vy_m_s = frames.base_from_frd(message.vx, right)
    omega_rad_s = frames.omega_from_yaw_rate_frd(message.yaw_rate) if used.yaw_rate else 0.0
    return Wanted(v_m_s, omega_rad_s, vy_m_s=vy_m_s)


def _local_velocity(
    message: Message, used: Used, theta_rad: float | None, *, holonomic: bool
) -> Wanted:
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
    if holonomic:
        heading_rad = None
        if used.yaw:
            _check_finite(message.yaw)
            heading_rad = frames.theta_from_yaw_ned(message.yaw)
        omega_rad_s = frames.omega_from_yaw_rate_frd(message.yaw_rate) if used.yaw_rate else 0.0
        return Wanted(velocity.x, omega_rad_s, heading_rad, velocity.y, in_world=True)
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
