"""The drive port: what `CanRobot` needs of a motor drive, whatever its make.

A kind of drive is a folder beside this file and a line in `DRIVES`. Its entry is the class of its
table `[[motor]]` in a robot's file, a `MotorConfig`, which makes the `MotorDrive`.

A drive does no input or output of its own: `CanRobot` hands it each frame that it listens to, and
gives it `send` when it may put frames on its bus. One tick is: the frames received, `check`,
`command`, and now and then `serve`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from robotctl.drivers.can.bus_load import Cyclic
from robotctl.drivers.can.bus_notes import BusNotes
from robotctl.drivers.can.bus_part import BusPart, Send
from robotctl.drivers.can.drives.axis import Axis, AxisConfig
from robotctl.drivers.can.nodes.robot_codec import RobotCodec
from robotctl.drivers.can.probe import Probe
from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.control import EmergencyStopSource
from robotctl.model.actuators import Abilities
from robotctl.safety.ages import AgeLimit
from robotctl.safety.state_machine import SafetyConfig


@dataclass(frozen=True, slots=True)
class DriveNeeds:
    """Demands of a robot on each of its drives.

    Parameters
    ----------
    rate_hz
        Rate of the control loop, and so of commands [Hz].
    command_timeout_ms
        Time without a command after which the drive must give no power [ms].
    heartbeat_timeout_ms
        A drive silent for longer is lost [ms].
    max_rad_s
        Greatest speed of a wheel that the robot's limits allow [rad/s].
    codec
        Codec of our own protocol.
    notes
        Notes about strangers and damaged frames, which all parts share.
    """

    rate_hz: int
    command_timeout_ms: int
    heartbeat_timeout_ms: int
    max_rad_s: float
    codec: RobotCodec
    notes: BusNotes

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        return 1_000_000_000 // self.rate_hz


class MotorDrive(BusPart, Protocol):
    """One motor drive, with one axis or several."""

    @property
    def reports(self) -> tuple[ActuatorFeedback, ...]:
        """The newest of each of its axes, in their order; another object only where it changed."""

    @property
    def proof(self) -> str | None:
        """Its settings for a host that falls silent, as read back from it, in words.

        None until they are known; empty where there is nothing to prove. The robot arms only with
        a drive that was seen to stop with just these.
        """

    def command(self, send: Send, command: ActuatorCommand, now_ns: int) -> None:
        """Send the command of this tick.

        Parameters
        ----------
        send
            Puts a frame on the bus.
        command
            Its `values` are those of the drive's axes, in their order. One that the wire cannot
            carry (nan, out of range) is sent as "no power".
        now_ns
            Present time [ns].
        """

    def emergency_stop(self, send: Send, source: EmergencyStopSource) -> bool:
        """Take the power at once and stay so until `clear_faults`; False if the bus is full."""

    def clear_faults(self) -> None:
        """Leave latched states with the next `serve`, if the causes are gone."""


class MotorConfig(Protocol):
    """A table `[[motor]]`: one drive of one kind."""

    @property
    def kind(self) -> str:
        """Kind of the drive."""

    @property
    def name(self) -> str:
        """Name of the drive, the `part` of its faults; each drive of a robot has its own."""

    @property
    def bus(self) -> str:
        """Name of its bus; empty: the first."""

    @property
    def node_ids(self) -> tuple[int, ...]:
        """Numbers that it takes on its bus, as its protocol counts them."""

    @property
    def axes(self) -> tuple[AxisConfig, ...]:
        """Its axes, and the wheels and joints on them."""

    @property
    def abilities(self) -> Abilities:
        """Abilities of drives of this kind."""

    @property
    def silence(self) -> str:
        """Reaction to a silent host, in words, as in docs/hardware.md."""

    @property
    def accept_coasting(self) -> bool:
        """Whether the file accepts that the wheels coast, or run on, when the host is silent."""

    @property
    def accept_timeout_ms(self) -> int:
        """Accepted longer command time-out of the drive [ms]; 0: the robot's own."""

    def ages(self, safety: SafetyConfig, period_ns: int) -> tuple[AgeLimit, ...]:
        """Return the maximum ages of its reports: "motion", "report" and "supply"."""

    def make(self, axes: tuple[Axis, ...], needs: DriveNeeds) -> MotorDrive:
        """Return the drive.

        Raises
        ------
        InvalidValue
            If it cannot do what is needed, such as so short a time-out.
        """

    def traffic(self, safety: SafetyConfig, rate_hz: int) -> tuple[Cyclic, ...] | None:
        """Return the frames that it and the host exchange all the time, at most.

        Parameters
        ----------
        safety
            Its time-outs decide how often heartbeats are sent.
        rate_hz
            Rate of the control loop [Hz].

        Returns
        -------
        tuple[Cyclic, ...] | None
            None where robot.dbc has them, as those of its node DRIVE.
        """

    @staticmethod
    def probe() -> Probe:
        """Return a probe that finds drives of this kind on a bus."""
