"""Messages of the robot that go to the page unchanged, and the parts that the server reads.

A class a message: its name is the message's, its fields are what the server needs. What it says in
`told` people must know: a message whose `told` differs from the last one's reaches every client.
"""

from __future__ import annotations

import re
from typing import ClassVar, Final, TypeAlias

import msgspec

from robotctl.messages.control import Ack, SafetyState
from robotctl.messages.faults import Fault
from robotctl.messages.mode import Mode
from robotctl.messages.tuning import ParameterFacts
from robotctl.model.geometry.localisation import LocalisationStatus


class Published(msgspec.Struct, frozen=True, tag=True):
    """Any message: a picture of the present, which the next one replaces."""

    is_event: ClassVar[bool] = False
    """Whether each of them reaches every client."""
    repeats: ClassVar[bool] = False
    """Whether one that says the same as the last one is left out."""

    @property
    def told(self) -> object:
        """The part of it that people must not miss."""
        return None


class ControlState(Published, frozen=True):
    """State of the control process."""

    stamp_ns: int
    state: SafetyState
    reason: str
    acks: tuple[Ack, ...] = ()
    armings: int = 0
    wheel_ref_rad_s: tuple[float, ...] = ()
    wheel_rad_s: tuple[float, ...] = ()
    against_arming: tuple[Fault, ...] = ()

    @property
    def told(self) -> object:
        """State, reasons, and answers."""
        acks = [ack.request_id for ack in self.acks]
        against = [fault.code for fault in self.against_arming]
        return self.state, _words(self.reason), acks, self.armings, against


class NamedFence(msgspec.Struct, frozen=True):
    """Name of the fence that navigation keeps to, 0: there is none."""

    crc: int = 0


class NavigationState(Published, frozen=True):
    """State of the navigation process."""

    stamp_ns: int
    mode: Mode
    message: str
    item: int
    mission_completed: bool
    mission_failed: bool
    goals: int = 0
    goal_reached: bool | None = None
    waits: bool = False
    trouble: str = ""
    held: bool = False
    mission_crc: int = 0
    mission_commands: int = 0
    fence: NamedFence = NamedFence()

    @property
    def told(self) -> object:
        """All but its time, and the figures of its messages, which count down."""
        _stamp_ns, mode, message, *rest = msgspec.structs.astuple(self)
        return mode, _words(message), rest


class LocalisationState(Published, frozen=True):
    """State of the localiser."""

    status: LocalisationStatus

    @property
    def told(self) -> object:
        """Whether the place is known."""
        return self.status


class Notice(Published, frozen=True):
    """Lines of text for people."""

    is_event: ClassVar[bool] = True


class LidarScan(Published, frozen=True):
    """One scan."""


class CameraView(Published, frozen=True):
    """Result of one picture of the camera."""


class ParticleCloud(Published, frozen=True):
    """Some of the particles."""


class PlanView(Published, frozen=True):
    """Plan that the robot drives by."""


class SlamGraph(Published, frozen=True):
    """The graph of SLAM as it grows."""


class MissionView(Published, frozen=True):
    """The mission's file, repeated for late subscribers."""

    repeats: ClassVar[bool] = True
    file: str
    crc: int
    content: bytes

    @property
    def told(self) -> object:
        """All but its time."""
        return self.file, self.crc, self.content


class BoundsView(Published, frozen=True):
    """Bounds that navigation keeps to, repeated for late subscribers."""

    repeats: ClassVar[bool] = True
    fence: msgspec.Raw
    fence_crc: int
    fence_enabled: bool
    zones: msgspec.Raw
    zones_crc: int
    rally: msgspec.Raw
    home: msgspec.Raw

    @property
    def told(self) -> object:
        """All that changes while the robot runs."""
        parts = (self.fence, self.zones, self.rally, self.home)
        return self.fence_crc, self.fence_enabled, self.zones_crc, *map(bytes, parts)


class LiveMap(Published, frozen=True):
    """The map as it grows."""


class ParameterAnswer(Published, frozen=True):
    """Answer to a request about parameters, for who made it."""

    request_id: int
    refusal: str


class ParameterTable(Published, frozen=True):
    """Description of all parameters."""

    parameters: tuple[ParameterFacts, ...]


class ParameterValues(Published, frozen=True):
    """Values of all parameters, repeated for late subscribers."""

    repeats: ClassVar[bool] = True

    wanted: tuple[bool | int | float, ...]
    in_force: tuple[bool | int | float, ...]

    @property
    def told(self) -> object:
        """All of them."""
        return self.wanted, self.in_force


class GivenMap(Published, frozen=True):
    """The localiser's map, repeated for late subscribers."""

    map: msgspec.Raw


class RecorderState(Published, frozen=True):
    """State of the recorder."""

    stamp_ns: int
    folder: str
    is_recording: bool
    trouble: str

    @property
    def told(self) -> object:
        """All but its time, and what is left on the disk."""
        return self.folder, self.is_recording, self.trouble


AnyPublished: TypeAlias = (
    ControlState
    | NavigationState
    | LocalisationState
    | Notice
    | LidarScan
    | CameraView
    | ParticleCloud
    | PlanView
    | LiveMap
    | GivenMap
    | SlamGraph
    | MissionView
    | BoundsView
    | ParameterAnswer
    | ParameterTable
    | ParameterValues
    | RecorderState
)

_FIGURES: Final = re.compile(r"[\d.]+")


def _words(text: str) -> str:
    """Return a text without its figures."""
    return _FIGURES.sub("", text)


_decoder: Final = msgspec.msgpack.Decoder(AnyPublished)


def read(data: bytes) -> AnyPublished | None:
    """Return what the server needs of a message; None: it is none for the page."""
    try:
        message: AnyPublished = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None
    return message


def with_tag(data: bytes, tag: str) -> bytes:
    """Return a message without one with a tag."""
    return msgspec.msgpack.encode({"type": tag, **msgspec.msgpack.decode(data)})
