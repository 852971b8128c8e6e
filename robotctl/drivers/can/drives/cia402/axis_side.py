"""One axis of a drive of CiA 402: its places in the process data, its state, fault and report."""

from __future__ import annotations

from typing import Final

from robotctl.drivers.can.drives.axis import Axis, Unwrapped
from robotctl.drivers.can.drives.cia402.dialects import Dialect
from robotctl.drivers.can.drives.cia402.wire import (
    FAULT,
    FAULT_REACTION,
    NOT_READY,
    OPERATION_ENABLED,
    STATES,
    STATUS_MASK,
    UNKNOWN,
    Received,
    Role,
)
from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback, DriveState
from robotctl.messages.faults import Fault, FaultCode

_NEW_NS: Final = 20_000_000
"""Maximum age of a current state [ns]."""


class AxisSide:
    """One axis: where its values are among those received, and what is read of it by SDO.

    Parameters
    ----------
    axis
        The axis.
    number
        Its place in the process data.
    received
        Values received.
    dialect
        Make of the drive.
    rad_per_unit
        Speed of the motor by its actual velocity [rad/s].
    counts_per_turn
        Position units in one turn of the motor.
    """

    __slots__ = (
        "_dialect",
        "_rad_per_unit",
        "_received",
        "_turns_per_count",
        "amps_place",
        "axis",
        "counter",
        "current_a",
        "error_place",
        "motion_pdos",
        "position_place",
        "speed_place",
        "status_pdo",
        "status_place",
        "temperature_c",
        "volts_place",
    )

    def __init__(
        self,
        axis: Axis,
        number: int,
        received: Received,
        dialect: Dialect,
        rad_per_unit: float,
        counts_per_turn: int,
    ) -> None:
        self.axis = axis
        self._received, self._dialect = received, dialect
        self._rad_per_unit, self._turns_per_count = rad_per_unit, 1.0 / counts_per_turn
        status = received.place(Role.STATUS, number)
        position = received.place(Role.POSITION, number)
        assert status is not None and position is not None  # noqa: S101, PT018 - of every layout
        self.status_place, self.position_place = status, position
        self.speed_place = received.place(Role.SPEED, number)
        error = received.place(Role.ERROR, number)
        self.error_place = received.place(Role.ERROR, 0) if error is None else error
        self.amps_place = received.place(Role.CURRENT, number)
        self.volts_place = received.place(Role.VOLTAGE, 0)
        self.counter = Unwrapped(32)
        self.current_a: float | None = None
        self.temperature_c: float | None = None
        pdos = (
            received.pdo_of(Role.STATUS, number),
            received.pdo_of(Role.SPEED, number),
            received.pdo_of(Role.POSITION, number),
        )
        self.status_pdo = pdos[0] or 0
        self.motion_pdos = tuple(pdo for pdo in pdos[1:] if pdo is not None)

    @property
    def state(self) -> int:
        """Last reported state."""
        return STATES[self._received.values[self.status_place] & STATUS_MASK]

    def is_enabled(self, now_ns: int) -> bool:
        """Return whether it reports now, and not only some time ago, that it is enabled."""
        told_ns = self._received.stamps_ns[self.status_pdo]
        return self.state == OPERATION_ENABLED and now_ns - told_ns <= _NEW_NS

    def forget_state(self) -> None:
        """Know nothing of its state: the drive is out of service."""
        self._received.values[self.status_place] = 0

    def fault(self, part: str, emergency_code: int) -> Fault:
        """Return the fault that it reports; the drive's name and its last emergency message."""
        values = self._received.values
        if self.state == UNKNOWN:
            text = f"status word 0x{values[self.status_place]:04X} is none of CiA 402"
            return Fault(FaultCode.DRIVE_UNREADABLE, text, part)
        place = self.error_place
        code = emergency_code if place is None else values[place] or emergency_code
        if not code:
            return Fault(FaultCode.DRIVE_FAULT, "the drive is in fault, without a code", part)
        meaning = self._dialect.decode_error(code)
        return Fault(meaning.code, f"{self.axis.name}: {meaning.words}", part)

    def report(
        self, interlock: Interlock, rated_a: float, voltage_v: float | None, supply_ns: int
    ) -> ActuatorFeedback:
        """Return its newest report.

        Parameters
        ----------
        interlock
            Latches of the drive.
        rated_a
            Rated current [A]; 0: it is not told.
        voltage_v, supply_ns
            Supply where it was read by SDO [V], and when [ns].
        """
        values, stamps_ns = self._received.values, self._received.stamps_ns
        axis, report_ns = self.axis, stamps_ns[self.status_pdo]
        if self.volts_place is not None:
            voltage_v, supply_ns = values[self.volts_place] * self._dialect.voltage_v, report_ns
        current_a, speed_place = self.current_a, self.speed_place
        if self.amps_place is not None and rated_a:
            current_a = axis.current_a(values[self.amps_place] * rated_a / 1000.0)
        speed_rad_s = None
        if speed_place is not None:
            speed_rad_s = axis.to_wheel(values[speed_place] * self._rad_per_unit)
        turns = self.counter.update(values[self.position_place]) * self._turns_per_count
        return ActuatorFeedback(
            min([stamps_ns[pdo] for pdo in self.motion_pdos]) or NEVER_NS,
            -1,
            axis.ticks(turns),
            speed_rad_s,
            None,
            report_ns or NEVER_NS,
            drive_state(self.state, interlock.state),
            interlock.fault,
            current_a,
            self.temperature_c,
            report_ns or NEVER_NS if voltage_v is None else supply_ns,
            voltage_v,
        )


def drive_state(state: int, latched: DriveState | None) -> DriveState:
    """Return how a state of CiA 402 is told, with a latched one."""
    if state == OPERATION_ENABLED:
        return DriveState.ENABLED
    if latched is not None:
        return latched
    if state in (FAULT, FAULT_REACTION):
        return DriveState.FAULT
    return DriveState.BOOT if state in (NOT_READY, UNKNOWN) else DriveState.READY
