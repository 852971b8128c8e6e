"""Messages between page and server.

Down to the page: msgpack, the robot's own messages as they were published and those of this
module; up from it: JSON. All have the key `type` with their name. `id` is the page's number of a
request. `at_ms` is when the user acted [ms] by the server's monotonic clock: the earliest time that
the page can prove by the newest `Pong`, so that an age is never found too small.
"""

from __future__ import annotations

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from robotctl.messages.mode import Mode
from robotctl.messages.requests import FARTHEST_M

PROTOCOL: Final = 1
"""Number of this set of messages; another one needs another page."""

Number: TypeAlias = Annotated[int, Meta(ge=-(2**53), le=2**53)]
"""A whole number that JavaScript knows exactly."""
Time: TypeAlias = Annotated[float, Meta(ge=-1e15, le=1e15)]
Coordinate: TypeAlias = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Angle: TypeAlias = Annotated[float, Meta(ge=-1e3, le=1e3)]
Axis: TypeAlias = Annotated[float, Meta(ge=-1.0, le=1.0)]


class Upward(msgspec.Struct, frozen=True, tag=True, forbid_unknown_fields=True):
    """Any message from the page."""


class Ping(Upward, frozen=True):
    """Question for the time; `t` comes back."""

    t: Time


class Stop(Upward, frozen=True):
    """Emergency stop, on the connection that is for nothing else."""

    id: Number


class StopRequest(Upward, frozen=True):
    """Emergency stop, on the connection of everything else."""

    id: Number


class ArmRequest(Upward, frozen=True):
    """Request to arm or disarm."""

    id: Number
    at_ms: Time
    arm: bool


class ModeRequest(Upward, frozen=True):
    """Request for a mode."""

    id: Number
    at_ms: Time
    mode: Mode


class GoTo(Upward, frozen=True):
    """Drive to a point of `world` [m], to end with a heading [rad]; None: any."""

    id: Number
    at_ms: Time
    x_m: Coordinate
    y_m: Coordinate
    heading_rad: Angle | None


class PlaceRobot(Upward, frozen=True):
    """Pose of the robot in `world` as a person sees it [m, m, rad]."""

    id: Number
    at_ms: Time
    x_m: Coordinate
    y_m: Coordinate
    theta_rad: Angle


class TakeDriving(Upward, frozen=True):
    """Request to be the driver."""

    id: Number
    at_ms: Time


class GiveDriving(Upward, frozen=True):
    """The driver is no longer one; who asked for it is the next."""


class Sticks(Upward, frozen=True):
    """Sticks in [-1, 1], forward, turn and sideways to the left, and the dead-man key.

    `sample` grows with each new sample of the input device.
    """

    sample: Number
    at_ms: Time
    held: bool
    forward: Axis
    turn: Axis
    sideways: Axis


class RecordRequest(Upward, frozen=True):
    """Request to start a recording, or to stop it."""

    id: Number
    at_ms: Time
    on: bool


Dated: TypeAlias = ArmRequest | ModeRequest | GoTo | PlaceRobot | TakeDriving | RecordRequest
LiveMessage: TypeAlias = Ping | StopRequest | GiveDriving | Sticks | Dated
StopMessage: TypeAlias = Ping | Stop


class Downward(msgspec.Struct, frozen=True, tag=True):
    """Any message of the server's own."""


class SonarOutline(msgspec.Struct, frozen=True):
    """Mounting of a sonar in `base` [m, m, rad]."""

    name: str
    x_m: float
    y_m: float
    heading_rad: float


class RobotOutline(msgspec.Struct, frozen=True):
    """Constants of the robot while it runs; `outline` are the corners of its body [m]."""

    name: str
    version: str
    simulated: bool
    drive: str
    holonomic: bool
    has_lidar: bool
    has_localiser: bool
    outline: tuple[tuple[float, float], ...]
    sonars: tuple[SonarOutline, ...]
    v_max_m_s: float
    omega_max_rad_s: float
    vy_max_m_s: float


class RecordedRun(msgspec.Struct, frozen=True):
    """Recording that is replayed: first and last time by the wall clock [ns].

    `run` is its number; None: this client has the times of all runs, and none of their messages.
    """

    name: str
    run: int | None
    begin_ns: int
    end_ns: int


class Hello(RobotOutline, frozen=True, tag=True, kw_only=True):
    """First message to a page: the robot, who this client is, and the two clocks [ns].

    `replay`: it is no robot that lives, but a recording.
    """

    protocol: int
    client: int
    role: str
    server_ns: int
    robot_ns: int
    replay: RecordedRun | None = None


class Pong(Downward, frozen=True):
    """Answer to `Ping`: its `t`, the server's monotonic clock and the robot's clock [ns]."""

    t: float
    server_ns: int
    robot_ns: int


class Driver(Downward, frozen=True):
    """Present driver by sticks, if there is one.

    `why` says why the one before lost it. `asking` is who wants to be the driver. `driving`: the
    sticks go to the robot now; `locked` says why not, though the key is held.
    """

    client: int | None
    name: str
    why: str
    asking: int | None
    asking_name: str
    driving: bool
    locked: str


class Refused(Downward, frozen=True):
    """A request that is not carried out, and why."""

    id: int
    reason: str


class StopSeen(Downward, frozen=True):
    """State of the robot after a stop, `after_ms` later; None: no answer yet, it is repeated."""

    id: int
    state: int | None
    reason: str
    after_ms: float


_encoder = msgspec.msgpack.Encoder()


def encode(message: Downward | Hello) -> bytes:
    """Return a message as the page reads it."""
    return _encoder.encode(message)
