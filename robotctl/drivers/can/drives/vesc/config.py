"""The table `[[motor]]` of a VESC."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

from robotctl.drivers.can.bus_load import Cyclic
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.drives.motor_drive import DriveNeeds
from robotctl.drivers.can.drives.vesc import wire
from robotctl.drivers.can.drives.vesc.drive import QUERY_NS, READING_NS, Currents, VescDrive
from robotctl.drivers.can.drives.vesc.scan import VescProbe
from robotctl.drivers.can.drives.vesc.settings import SUPERVISION_MS, Silence, single
from robotctl.drivers.can.drives.vesc.steering import Servo
from robotctl.drivers.can.drives.vesc.wire import ID_MAX
from robotctl.drivers.can.probe import Probe
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Abilities, Takes
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig

MOTOR_AXIS, SERVO_AXIS = 1, 2
"""Numbers of the axes of a VESC: its motor, and its servo output."""

_CURRENT_MAX_A: Final = 1000.0
"""Maximum of a configured current [A]: beyond, a setting is a slip."""

_SETTINGS_FRAMES: Final = 70
"""Frames of one reading of the settings."""

_BRAKES: Final = Abilities(takes=Takes.SPEED, stops_alone=True, brakes=True)
_COASTS: Final = Abilities(takes=Takes.SPEED, stops_alone=True, brakes=False)


@dataclass(frozen=True, slots=True)
class VescServo:
    """Servo output of a VESC: pulses of 1 to 2 ms for positions 0 to 1.

    Parameters
    ----------
    centre
        Position at angle 0, 0 to 1.
    range_deg
        Turn of the servo from position 0 to 1 [deg].
    rate_deg_s
        Speed of the servo [deg/s]: it does not tell its angle, so that this is what it is taken
        to follow by.
    """

    centre: float = 0.5
    range_deg: float = 90.0
    rate_deg_s: float = 350.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not 0.0 < self.centre < 1.0:
            raise InvalidValue(
                "centre", f"must be between 0 and 1, not {self.centre:g}", self.centre
            )
        for key, most in (("range_deg", 360.0), ("rate_deg_s", 10_000.0)):
            value = getattr(self, key)
            if not 0.0 < value <= most:
                raise InvalidValue(key, f"must be above 0, at most {most:g}, not {value:g}", value)


@dataclass(frozen=True, slots=True)
class VescMotor:
    """One VESC, or drive with its firmware.

    Parameters
    ----------
    kind
        `vesc`.
    name
        Name of the drive.
    axes
        What it turns: axis 1 is the motor, axis 2 the servo output.
    bus
        Name of its bus; empty: the first.
    node_id
        Number of the VESC, 0 to 254, as set in VESC Tool.
    pole_pairs
        Pole pairs of the motor: electrical turns for one of its shaft.
    brake_current_a
        Motor current with which it brakes when it is to, and after its time-out [A]; 0: it coasts.
    accept_coasting
        Whether it may coast when the host dies; needed where `brake_current_a` is 0.
    accept_timeout_ms
        Time-out as set in VESC Tool, accepted though it is not the robot's [ms]; for firmware whose
        time-out the host cannot set. 0: the host sets the robot's.
    handbrake_current_a
        Motor current that holds the wheel when it stands and is to brake [A]; 0: it is not held.
    motor_temperature
        Whether a sensor of temperature is fitted in the motor; else that of the drive is told.
    status_rate_hz
        Rate of status 1 and 5, as set in VESC Tool [Hz], 50 to 1000.
    servo
        What is at the servo output, for axis 2.
    """

    kind: Literal["vesc"]
    name: str
    axes: tuple[AxisConfig, ...]
    bus: str = ""
    node_id: int = 0
    pole_pairs: int = 7
    brake_current_a: float = 0.0
    accept_coasting: bool = False
    accept_timeout_ms: int = 0
    handbrake_current_a: float = 0.0
    motor_temperature: bool = False
    status_rate_hz: int = 200
    servo: VescServo = VescServo()

    silence: ClassVar[str] = (
        "after its time-out it brakes with brake_current_a; with 0 it coasts. Not latched: it "
        "would obey the next command. The servo stays where it is."
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        for key, most in (("node_id", ID_MAX), ("accept_timeout_ms", 60_000)):
            self._check(key, 0, most)
        self._check("pole_pairs", 1, 100)
        self._check("status_rate_hz", 50, 1000)
        for key in ("brake_current_a", "handbrake_current_a"):
            self._check(key, 0.0, _CURRENT_MAX_A)
        numbers = [axis.axis for axis in self.axes]
        if sorted(numbers) not in ([MOTOR_AXIS], [MOTOR_AXIS, SERVO_AXIS]):
            raise InvalidValue(
                "axes", f"must be axis 1 (motor), or 1 and 2 (servo), not {numbers}", numbers
            )
        if self.brake_current_a == 0.0 and not self.accept_coasting:
            raise InvalidValue(
                "brake_current_a",
                "is 0, with which the robot coasts when the host dies: give it a current, or add "
                "accept_coasting = true",
                self.brake_current_a,
            )

    def _check(self, key: str, least: float, most: float) -> None:
        value = getattr(self, key)
        if not least <= value <= most:
            raise InvalidValue(key, f"must be {least:g} to {most:g}, not {value:g}", value)

    @property
    def abilities(self) -> Abilities:
        """Abilities; it brakes only with a brake current."""
        return _BRAKES if self.brake_current_a > 0.0 else _COASTS

    @property
    def reply_to(self) -> int:
        """Number to which the drive sends its answers; no VESC may have it."""
        return (self.node_id + 128) % (ID_MAX + 1)

    @property
    def node_ids(self) -> tuple[int, ...]:
        """Its own number, and that for its answers."""
        return (self.node_id, self.reply_to)

    def ages(self, safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
        """Return the maximum ages of motion, report and supply."""
        sent_ns = max(period_ns, 1_000_000_000 // self.status_rate_hz)
        motion_ns = safety.feedback_timeout_periods * sent_ns
        status_ns = safety.status_timeout_ms * 1_000_000
        name = self.name
        return (
            AgeLimit("motion", FaultCode.WHEELS_STALE, "status 1 and 5 are", name, motion_ns),
            AgeLimit("report", FaultCode.MOTOR_STALE, "answer on faults is", name, status_ns),
            AgeLimit("supply", FaultCode.DRIVE_STALE, "status 5 is", name, status_ns),
        )

    def make(self, axes: tuple[Axis, ...], needs: DriveNeeds) -> VescDrive:
        """Return the drive; raises InvalidValue if its time-out cannot be as short."""
        for axis in axes:
            wanted = Takes.SPEED if axis.number == MOTOR_AXIS else Takes.ANGLE
            if axis.takes is not wanted:
                raise InvalidValue(
                    "axes",
                    f"axis {axis.number} of a VESC takes a {wanted.value}, {axis.name} takes a "
                    f"{axis.takes.value}",
                    axis.name,
                )
        timeout_ms = self.accept_timeout_ms
        if not timeout_ms:
            timeout_ms = needs.command_timeout_ms - SUPERVISION_MS
            least_ms = 2000 / needs.rate_hz
            if timeout_ms < least_ms:
                raise InvalidValue(
                    "command_timeout_ms",
                    f"must be at least {least_ms + SUPERVISION_MS:g} for the VESC {self.name!r}, "
                    f"not {needs.command_timeout_ms}: it looks every {SUPERVISION_MS} ms",
                    needs.command_timeout_ms,
                )
        servo = self.servo
        return VescDrive(
            self.name,
            self.node_id,
            self.reply_to,
            axes,
            needs,
            self.pole_pairs,
            Silence(timeout_ms, single(self.brake_current_a)),
            not self.accept_timeout_ms,
            Currents(self.brake_current_a, self.handbrake_current_a),
            Servo(servo.centre, math.radians(servo.range_deg), math.radians(servo.rate_deg_s)),
            motor_temperature=self.motor_temperature,
        )

    def traffic(self, safety: SafetyConfig, rate_hz: int) -> tuple[Cyclic, ...] | None:  # noqa: ARG002 - as of every drive
        """Return its frames: commands, all status messages, and reads of faults and settings."""
        name, number, reply_to = self.name, self.node_id, self.reply_to
        query_hz, status_hz = 1e9 / QUERY_NS, float(self.status_rate_hz)
        settings_hz = _SETTINGS_FRAMES * 1e9 / READING_NS
        frames = [
            Cyclic(f"{name} command", wire.identifier(wire.SET_RPM, number), 4, rate_hz),
            Cyclic(
                f"{name} answers",
                wire.identifier(wire.FILL_RX_BUFFER, reply_to),
                8,
                query_hz + settings_hz,
            ),
            Cyclic(
                f"{name} end of answers",
                wire.identifier(wire.PROCESS_RX_BUFFER, reply_to),
                6,
                query_hz,
            ),
            Cyclic(
                f"{name} questions",
                wire.identifier(wire.PROCESS_SHORT_BUFFER, number),
                8,
                query_hz + (rate_hz if len(self.axes) > 1 else 0.0),
            ),
        ]
        frames += [
            Cyclic(f"{name} status {word}", wire.identifier(command, number), 8, status_hz)
            for word, command in enumerate(wire.STATUS_COMMANDS, 1)
        ]
        return tuple(frames)

    @staticmethod
    def probe() -> Probe:
        """Return a probe that finds drives of this kind."""
        return VescProbe()
