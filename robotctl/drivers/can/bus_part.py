"""The part of a bus: what the host's side of it needs of each drive and sensor there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol, TypeAlias

from robotctl.messages.control import NodeStatus

Handler: TypeAlias = Callable[[bytes, int], None]
"""Takes data and time of reception [ns] of a frame."""

Send: TypeAlias = Callable[[int, bytes], bool]
"""`CanPort.send` of the drive's bus."""


class BusPart(Protocol):
    """Whatever the host talks to on a bus: a drive or a sensor."""

    @property
    def handlers(self) -> Mapping[int, Handler]:
        """Frames that it listens to, by `Frame.arbitration_id`; fixed once it is made."""

    @property
    def host_frames(self) -> Mapping[int, str]:
        """Names of the frames on its bus that only the host may send, by identifier."""

    @property
    def wants_sync(self) -> bool:
        """Whether it waits for CANopen's SYNC, once a tick behind the commands."""

    @property
    def status(self) -> NodeStatus:
        """Whether it is there and in service, and why not; another object only where it changed."""

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now."""

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame (identity, settings, state changes); return whether it did."""
