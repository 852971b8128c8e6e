"""The table `[[motor]]` of a moteus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from robotctl.drivers.can.bus_load import Cyclic
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.drive import MoteusDrive
from robotctl.drivers.can.drives.moteus.scan import MoteusProbe
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.probe import Probe
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Abilities, Takes
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig


@dataclass(frozen=True, slots=True)
class MoteusMotor:
    """One moteus, on a bus with CAN FD.

    Parameters
    ----------
    kind
        Always "moteus".
    name
        Name of the drive in messages and logs.
    axes
        The wheel on its motor, axis 1. Its `ratio` is that from the drive's output
        (`motor_position.rotor_to_output_ratio`) to the wheel.
    bus
        Name of its bus; empty: the first.
    node_id
        Number of the drive, 1 to 126 (`id.id`).
    accept_coasting
        Whether it is to coast when the host dies; else it shorts the motor, which brakes it.
    """

    kind: Literal["moteus"]
    name: str
    axes: tuple[AxisConfig, ...]
    bus: str = ""
    node_id: int = 1
    accept_coasting: bool = False

    accept_timeout_ms: ClassVar[int] = 0
    abilities: ClassVar[Abilities] = Abilities(takes=Takes.SPEED, stops_alone=True, brakes=True)
    silence: ClassVar[str] = (
        "shorts the motor, or coasts where that is accepted, after safety.command_timeout_ms, and "
        "latches"
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 1 <= self.node_id <= wire.ID_MAX:
            raise InvalidValue(
                "node_id", f"must be 1 to {wire.ID_MAX}, not {self.node_id}", self.node_id
            )
        numbers = [axis.axis for axis in self.axes]
        if numbers != [1]:
            raise InvalidValue("axes", f"must be axis 1 alone, not {numbers}", numbers)

    @property
    def node_ids(self) -> tuple[int, ...]:
        """Its number."""
        return (self.node_id,)

    def ages(self, safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
        """Return the maximum ages of its reports: one answer has all of it."""
        motion_ns = safety.feedback_timeout_periods * period_ns
        status_ns = safety.status_timeout_ms * 1_000_000
        name = self.name
        return (
            AgeLimit("motion", FaultCode.WHEELS_STALE, "answer of the moteus is", name, motion_ns),
            AgeLimit("report", FaultCode.MOTOR_STALE, "answer of the moteus is", name, status_ns),
            AgeLimit("supply", FaultCode.DRIVE_STALE, "answer of the moteus is", name, status_ns),
        )

    def make(self, axes: tuple[Axis, ...], needs: DriveNeeds) -> MoteusDrive:
        """Return the drive; raises InvalidValue if its axis is a joint."""
        (axis,) = axes
        if axis.takes is not Takes.SPEED:
            raise InvalidValue(
                "axes",
                f"a moteus takes a speed, {axis.name} takes an {axis.takes.value}",
                axis.name,
            )
        mode = wire.STOPPED if self.accept_coasting else wire.BRAKE
        return MoteusDrive(self.name, self.node_id, axis, needs, mode)

    def traffic(self, safety: SafetyConfig, rate_hz: int) -> tuple[Cyclic, ...] | None:  # noqa: ARG002 - as of every drive
        """Return its frames: each tick a command and its answer.

        The settings are read once a second, with a few frames that are not among them.
        """
        answer_id = max(wire.answer_ids(self.node_id))
        return (
            Cyclic(f"{self.name} command", wire.command_id(self.node_id), 32, rate_hz),
            Cyclic(f"{self.name} answer", answer_id, 32, rate_hz),
        )

    @staticmethod
    def probe() -> Probe:
        """Return a probe that finds drives of this kind."""
        return MoteusProbe()
