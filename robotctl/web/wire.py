"""Messages between page and server.

Down to the page: msgpack, an array of messages in each frame, the robot's own as they were
published and those of this module; up from it: JSON. All have the key `type` with their name. `id`
is the page's number of a request. `at_ms` is when the user acted [ms] by the server's monotonic
clock: the earliest time that the page can prove by the newest `Pong`, so that an age is never found
too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from robotctl.messages.mode import Mode
from robotctl.messages.requests import FARTHEST_M

PROTOCOL: Final = 2
"""Number of this set of messages; another one needs another page."""

Number: TypeAlias = Annotated[int, Meta(ge=-(2**53), le=2**53)]
"""A whole number that JavaScript knows exactly."""
Time: TypeAlias = Annotated[float, Meta(ge=-1e15, le=1e15)]
Coordinate: TypeAlias = Annotated[float, Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
Angle: TypeAlias = Annotated[float, Meta(ge=-1e3, le=1e3)]
Axis: TypeAlias = Annotated[float, Meta(ge=-1.0, le=1.0)]
ParameterName: TypeAlias = Annotated[str, Meta(max_length=16)]


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


class TuneRequest(Upward, frozen=True):
    """Request to set a parameter; `value` None: to that of the robot's file."""

    id: Number
    at_ms: Time
    name: ParameterName
    value: float | None


class ResetRequest(Upward, frozen=True):
    """Request to set all parameters to the values of the robot's file."""

    id: Number
    at_ms: Time


class SaveRequest(Upward, frozen=True):
    """Request to write the present values of all parameters into the robot's file."""

    id: Number
    at_ms: Time


class ResponseRequest(Upward, frozen=True):
    """Request for what the wheels were to do and did within the last seconds."""

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


class GoOn(Upward, frozen=True):
    """Go on with a mission that waits for an operator's word."""

    id: Number
    at_ms: Time


class JumpTo(Upward, frozen=True):
    """Go on with another item of the mission, counted from 1."""

    id: Number
    at_ms: Time
    item: Number


class Abort(Upward, frozen=True):
    """Abort the mission: the robot stands, and AUTO would start it from its first item."""

    id: Number
    at_ms: Time


class WatchCamera(Upward, frozen=True):
    """Camera panel opened or closed; only pages with it open are sent pictures."""

    watch: bool


class RecordRequest(Upward, frozen=True):
    """Request to start a recording, or to stop it."""

    id: Number
    at_ms: Time
    on: bool


Tuned: TypeAlias = TuneRequest | ResetRequest | SaveRequest | ResponseRequest
Order: TypeAlias = GoOn | JumpTo | Abort
Dated: TypeAlias = (
    ArmRequest | ModeRequest | GoTo | PlaceRobot | TakeDriving | RecordRequest | Order | Tuned
)
LiveMessage: TypeAlias = Ping | StopRequest | GiveDriving | Sticks | WatchCamera | Dated
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
    """Constants of the robot while it runs.

    `bodies` are the polygons that make up its body in each state [m], in order of their numbers.
    """

    name: str
    version: str
    simulated: bool
    drive: str
    holonomic: bool
    has_lidar: bool
    has_localiser: bool
    bodies: tuple[tuple[tuple[tuple[float, float], ...], ...], ...]
    sonars: tuple[SonarOutline, ...]
    v_max_m_s: float
    omega_max_rad_s: float
    vy_max_m_s: float
    wheels: tuple[str, ...] = ()
    file: str = ""
    """Name of the robot's file, where the page may write it; empty: it may not."""


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


class CameraPicture(Downward, frozen=True):
    """Picture of the camera, and what the robot makes of it, in its pixels.

    `boundary` is where the floor ends, from left to right, None where that is not judged; `floor`
    where floor is seen as far as the camera judges it; `things` are the middles of obstacles' feet
    and their widths. `trouble` says why the picture is not to be trusted.
    """

    stamp_ns: int
    width: int
    height: int
    jpeg: bytes
    boundary: tuple[tuple[float, float] | None, ...] = ()
    floor: tuple[tuple[float, float] | None, ...] = ()
    things: tuple[tuple[float, float, float], ...] = ()
    trouble: str = ""


class Saved(Downward, frozen=True):
    """The robot's file was written: its name, that of the copy of the old one, and what is new."""

    id: int
    file: str
    copy: str
    keys: tuple[str, ...]


class Response(Downward, frozen=True):
    """Speeds that the wheels were to have and had [rad/s], a tuple for each time [ns]."""

    id: int
    stamp_ns: tuple[int, ...]
    wheel_ref_rad_s: tuple[tuple[float, ...], ...]
    wheel_rad_s: tuple[tuple[float, ...], ...]


class ComputerState(Downward, frozen=True):
    """Figures of the robot's computer: share of all cores that is busy, hottest sensor [degC].

    Memory and disk are in bytes. None: not known.
    """

    processor: float | None
    temperature_c: float | None
    memory_free: int
    memory: int
    disk_free: int | None


_encoder = msgspec.msgpack.Encoder()


def encode(message: Downward | Hello) -> bytes:
    """Return a message as the page reads it."""
    return _encoder.encode(message)


def frame(messages: Sequence[bytes]) -> bytes:
    """Return encoded messages as one frame: an array of MessagePack, at most 65535 long."""
    count = len(messages)
    head = bytes([0x90 | count]) if count < 16 else b"\xdc" + count.to_bytes(2, "big")
    return b"".join((head, *messages))
