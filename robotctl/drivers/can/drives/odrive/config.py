"""The table `[[motor]]` of an ODrive axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final, Literal

from robotctl.drivers.can.bus_load import Cyclic
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.motor_drive import DriveNeeds, MotorDrive
from robotctl.drivers.can.drives.odrive import wire
from robotctl.drivers.can.drives.odrive.drive import ODrive
from robotctl.drivers.can.drives.odrive.scan import ODriveProbe
from robotctl.drivers.can.drives.odrive.wire import NODE_ID_MAX, Command, NewCommand
from robotctl.drivers.can.probe import Probe
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Abilities, Takes
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

_ENDPOINT_MAX: Final = 0xFFFF
_HEARTBEAT_HZ: Final = 10.0
_ESTIMATES_HZ: Final = 100.0
"""Rates of unrequested messages, by factory settings [Hz]."""

_TURN: Final = 20
"""Control periods in which the voltage is asked for three times, so that two may be lost."""


@dataclass(frozen=True, slots=True)
class ODriveMotor:
    """One axis of an ODrive with firmware 0.5 or 0.6, in closed-loop velocity control.

    Parameters
    ----------
    kind
        Always "odrive".
    name
        Name of the drive in messages and logs.
    axes
        The wheel on it, as axis 1: each axis of a board has a node number, and so a table, of its
        own.
    node_id
        Number of the node, 0 to 62: `axis0.config.can.node_id` in odrivetool.
    bus
        Name of its bus; empty: the first.
    watchdog_endpoints
        Numbers of `axis0.config.watchdog_timeout` and `axis0.config.enable_watchdog` in the
        `flat_endpoints.json` that ODrive publishes with each release of firmware 0.6, for just this
        hardware and firmware; empty: those that are known. Wrong ones write other settings.
    """

    kind: Literal["odrive"]
    name: str
    axes: tuple[AxisConfig, ...]
    node_id: int
    bus: str = ""
    watchdog_endpoints: tuple[int, ...] = ()

    accept_coasting: ClassVar[bool] = False
    accept_timeout_ms: ClassVar[int] = 0
    abilities: ClassVar[Abilities] = Abilities(takes=Takes.SPEED, stops_alone=True, brakes=False)
    silence: ClassVar[str] = (
        "coasts after safety.command_timeout_ms and latches, once its watchdog is on, which by "
        "default it is not: with firmware 0.6 the host sets it, with 0.5 odrivetool must"
    )

    def __post_init__(self) -> None:
        """Check axes and numbers."""
        numbers = [axis.axis for axis in self.axes]
        if numbers != [1]:
            found = ", ".join(map(str, numbers)) or "none"
            raise InvalidValue("axes", f"must be one, with axis = 1, found {found}", numbers)
        if not 0 <= self.node_id <= NODE_ID_MAX:
            raise InvalidValue(
                "node_id", f"must be 0 to {NODE_ID_MAX}, not {self.node_id}", self.node_id
            )
        ids = self.watchdog_endpoints
        if ids and (len(set(ids)) != 2 or not all(0 < each <= _ENDPOINT_MAX for each in ids)):
            raise InvalidValue(
                "watchdog_endpoints",
                f"must be two different numbers of 1 to {_ENDPOINT_MAX}, or none, not {list(ids)}",
                ids,
            )

    @property
    def node_ids(self) -> tuple[int, ...]:
        """Number that it takes on its bus."""
        return (self.node_id,)

    def ages(self, safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
        """Return the maximum ages of its reports: its state comes with its heartbeat."""
        motion_ns = safety.feedback_timeout_periods * period_ns
        state_ns = safety.heartbeat_timeout_ms * 1_000_000
        supply_ns = max(safety.status_timeout_ms * 1_000_000, _TURN * period_ns)
        name = self.name
        return (
            AgeLimit("motion", FaultCode.WHEELS_STALE, "encoder estimate is", name, motion_ns),
            AgeLimit("report", FaultCode.MOTOR_STALE, "axis state is", name, state_ns),
            AgeLimit("supply", FaultCode.DRIVE_STALE, "bus voltage is", name, supply_ns),
        )

    def make(self, axes: tuple[Axis, ...], needs: DriveNeeds) -> MotorDrive:
        """Return the drive."""
        (axis,) = axes
        return ODrive(self.name, self.node_id, axis, needs, self.watchdog_endpoints)

    def traffic(self, safety: SafetyConfig, rate_hz: int) -> tuple[Cyclic, ...] | None:  # noqa: ARG002 - as of every drive
        """Return its frames: each tick a command, and two requests with their answers.

        Estimates and heartbeat come by themselves besides, at the rates as it is delivered.
        """
        name, node_id = self.name, self.node_id
        turn = NewCommand.ERROR  # one of several messages of the same length, asked for in turn
        return (
            Cyclic(f"{name} heartbeat", wire.can_id(node_id, Command.HEARTBEAT), 8, _HEARTBEAT_HZ),
            Cyclic(f"{name} status", wire.can_id(node_id, turn), 8, rate_hz),
            Cyclic(f"{name} status?", wire.request_id(node_id, turn), 0, rate_hz),
            Cyclic(
                f"{name} estimates",
                wire.can_id(node_id, Command.ENCODER_ESTIMATES),
                8,
                rate_hz + _ESTIMATES_HZ,
            ),
            Cyclic(
                f"{name} estimates?",
                wire.request_id(node_id, Command.ENCODER_ESTIMATES),
                0,
                rate_hz,
            ),
            Cyclic(f"{name} command", wire.can_id(node_id, Command.SET_INPUT_VEL), 8, rate_hz),
        )

    @staticmethod
    def probe() -> Probe:
        """Return a probe that finds drives of this kind."""
        return ODriveProbe()
