"""A drive that `Session` follows: what the makes have in common behind the drive port."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from robotctl.drivers.can.bus_part import Handler
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.session import Script, Session
from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.control import NodeStatus


class Settings(Protocol):
    """Scripts of one drive."""

    @property
    def proof(self) -> str | None:
        """Its settings for a silent host as read back, in words; None before."""

    def commission(self) -> Script:
        """Identify the drive, set its settings and read them back."""

    def watch(self) -> Script:
        """Read the settings again."""


class SessionDrive:
    """Base of such drives; see `MotorDrive` for what a subclass adds.

    Parameters
    ----------
    name, number
        Name of the drive, and its number on the bus.
    call
        Frame that makes it answer, as `Session` needs it; None: it has a heartbeat.
    settings
        Its scripts.
    reading_ns
        Period of reading the settings again [ns].
    needs
        Demands of the robot.
    axes
        Number of its axes.
    """

    wants_sync = False
    handlers: Mapping[int, Handler]
    host_frames: Mapping[int, str]

    def __init__(
        self,
        name: str,
        number: int,
        call: tuple[int, bytes] | None,
        settings: Settings,
        reading_ns: int,
        needs: DriveNeeds,
        axes: int = 1,
    ) -> None:
        self._notes = needs.notes
        self._session = Session(
            number,
            name,
            call,
            settings.commission,
            settings.watch,
            reading_ns,
            needs.heartbeat_timeout_ms * 1_000_000,
        )
        self._given = settings
        self._clear_wanted = False
        self._boots = 0
        self.reports: tuple[ActuatorFeedback, ...] = (ActuatorFeedback(),) * axes

    @property
    def status(self) -> NodeStatus:
        """Whether it is there and in service, and why not."""
        return self._session.status

    @property
    def proof(self) -> str | None:
        """Its settings for a silent host, as read back."""
        return self._given.proof

    def check(self, now_ns: int) -> None:
        """Judge what was received up to now: update `reports` and `status`."""
        session = self._session
        session.check(now_ns)
        if session.boots != self._boots:
            self._boots = session.boots
            self._restarted(now_ns)
        if self._follow(session.in_service):
            self.reports = self._report()

    def clear_faults(self) -> None:
        """Leave latched states with the next `serve`, if the causes are gone."""
        self._clear_wanted = True

    # What a make adds ---------------------------------------------------------------------------

    def _restarted(self, now_ns: int) -> None:
        """Follow a drive that has come, or come again."""

    def _follow(self, in_service: bool) -> bool:
        """Follow the service; return whether the reports change."""
        raise NotImplementedError

    def _report(self) -> tuple[ActuatorFeedback, ...]:
        """Return the reports of all axes."""
        raise NotImplementedError
