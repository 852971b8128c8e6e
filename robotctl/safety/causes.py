"""Root causes: why an input fell silent, by what else was wrong shortly before or behind that.

A cable, a supply and a babbling device all end in "wheel feedback is older than 15 ms", which stops
the robot before anything else is known. What is known then, and what shows up within a quarter of a
second, tells them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from robotctl.messages.actuators import NEVER_NS
from robotctl.messages.control import BusState, BusStatus, Feedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.actuators import Actuator
from robotctl.safety.emergency_codes import emergency_words

BEFORE_NS: Final = 500_000_000
"""Time before a symptom in which its cause may have been seen [ns]."""

AFTER_NS: Final = 250_000_000
"""Time after a symptom in which its cause may yet show up [ns]."""

RETURN_NS: Final = 3_000_000_000
"""Time after a symptom in which a node that restarts may be back [ns]: drives boot for a second."""

SILENT_NS: Final = 150_000_000
"""Silence in which a heartbeat of every node is missing [ns]: all of them are silent."""

ERRORS: Final = 12
"""Error frames within `TOGETHER_NS` that disturb more than a frame or two."""

TOGETHER_NS: Final = 100_000_000

LOW_SHARE: Final = 0.8
"""Share of what the drive's supply was that no motor of a healthy robot makes it fall to."""

_FORGET: Final = 0.98
"""Per status of the drive, of its highest supply: half of it in 0.7 s."""

_SYMPTOMS: Final = frozenset(
    {
        FaultCode.WHEELS_STALE,
        FaultCode.MOTOR_STALE,
        FaultCode.DRIVE_STALE,
        FaultCode.BATTERY_STALE,
        FaultCode.SONAR_STALE,
        FaultCode.IMU_STALE,
        FaultCode.COMMAND_LOSS,
        FaultCode.DRIVE_STOPPED,
        FaultCode.DRIVE_COMMAND_TIMEOUT,
        FaultCode.NODE_SILENT,
        FaultCode.NODE_RESTARTED,
    }
)
"""Faults that say what is missing, not why."""

_UNHEARD: Final = _SYMPTOMS - {FaultCode.COMMAND_LOSS, FaultCode.DRIVE_COMMAND_TIMEOUT}
"""Symptoms of a node that restarts."""

_DRIVE: Final = "drive"
_DRIVE_NODE: Final = 1
STRANGER_RANK: Final = -1
"""Rank of another sender that is told by its frames: nothing else explains those."""
_BLOCKED_RANK, _RETURN_RANK, _SILENT_RANK, _UNEXPLAINED_RANK = 3, 4, 5, 6

_EMERGENCIES: Final = {
    0x2310: FaultCode.DRIVE_OVER_CURRENT,
    0x4310: FaultCode.DRIVE_OVER_TEMPERATURE,
    0x3220: FaultCode.DRIVE_UNDER_VOLTAGE,
}
"""Errors of the drive after which it may fall silent, by their EMCY code."""

_ERROR_PASSIVE: Final = BusState.ERROR_PASSIVE
"""Looking up a member of an enumeration is slow."""

_DEAD: Final = {BusState.BUS_OFF: FaultCode.BUS_OFF, BusState.DOWN: FaultCode.BUS_DOWN}


class Explained(NamedTuple):
    """A symptom with its cause; of two explanations that of lower rank is nearer to the root."""

    rank: int
    fault: Fault


class _Supply:
    """Supply of a drive: now, and the highest of late before that [V]."""

    def __init__(self, actuator: int) -> None:
        self.actuator = actuator
        """One whose reports tell it, by its place."""
        self.now_v = self.before_v = 0.0
        self.stamp_ns = NEVER_NS

    def take(self, volts: float, stamp_ns: int) -> None:
        """Note what the drive told at a time [ns]."""
        self.before_v = max(self.now_v, _FORGET * self.before_v)
        self.now_v, self.stamp_ns = volts, stamp_ns


class Causes:
    """Evidence of what may have silenced a node or the whole bus.

    Parameters
    ----------
    actuators
        Those of the robot.
    """

    def __init__(self, actuators: Sequence[Actuator]) -> None:
        drives = [each.drive for each in actuators]
        self._supplies = {drive: _Supply(drives.index(drive)) for drive in drives}
        self._bus = BusStatus()
        self._dead: BusState | None = None
        self._dead_ns = self._passive_ns = NEVER_NS
        self._errors = self._errors_before = 0
        """Error frames since `_errors_ns`, for `TOGETHER_NS` at most, and in such a time before."""
        self._errors_ns = self._refused_ns = NEVER_NS
        """When they began; when the bus last refused a frame of the host [ns]."""
        self._received_ns = 0
        self._emergency: int | None = None
        self._emergency_ns = NEVER_NS

    @staticmethod
    def is_symptom(fault: Fault) -> bool:
        """Return whether a fault says what is missing, and not why."""
        return fault.code in _SYMPTOMS

    def take(self, feedback: Feedback, now_ns: int) -> None:
        """Note what the inputs of one tick prove."""
        bus = feedback.bus
        if bus is not self._bus:
            self._take_bus(bus, now_ns)
        for each in feedback.emergencies:
            if each.node_id == _DRIVE_NODE and each.code in _EMERGENCIES:
                self._emergency, self._emergency_ns = each.code, now_ns
        reports = feedback.actuators
        if not reports:
            return
        for supply in self._supplies.values():
            report = reports[supply.actuator]
            volts = report.voltage_v
            # A negative one is a damaged frame.
            if report.supply_ns > supply.stamp_ns and volts is not None and volts >= 0.0:
                supply.take(volts, report.supply_ns)

    def _take_bus(self, bus: BusStatus, now_ns: int) -> None:
        """Note errors, refusals and silence of the bus."""
        before, self._bus = self._bus, bus
        if bus.received != before.received:
            self._received_ns = now_ns
        if bus.error_frames != before.error_frames:
            elapsed_ns = now_ns - self._errors_ns
            if elapsed_ns > TOGETHER_NS:
                self._errors_before = self._errors if elapsed_ns < 2 * TOGETHER_NS else 0
                self._errors, self._errors_ns = 0, now_ns
            self._errors += bus.error_frames - before.error_frames
        if bus.send_failures != before.send_failures:
            self._refused_ns = now_ns
        if bus.state in _DEAD:
            self._dead, self._dead_ns = bus.state, now_ns
        elif bus.state is _ERROR_PASSIVE and before.state is not bus.state:
            self._passive_ns = now_ns

    def explain(self, symptom: Fault, began_ns: int, now_ns: int) -> Explained:
        """Return a fault with its cause, if one has been seen by now [ns].

        Parameters
        ----------
        symptom
            What the robot has stopped for; a fault that is its own cause is returned as it is.
        began_ns, now_ns
            When it stopped, and now [ns].
        """
        if self.is_symptom(symptom):
            since_ns = began_ns - BEFORE_NS
            for rank, find in enumerate((self._dead_bus, self._drive, self._errors_of_bus)):
                cause = find(symptom, since_ns)
                if cause is not None:
                    return Explained(rank, because(cause, symptom))
            cause = self._no_traffic(now_ns)
            if cause is not None:
                blocked = cause.code is FaultCode.BUS_BLOCKED
                rank = _BLOCKED_RANK if blocked else _SILENT_RANK
                return Explained(rank, because(cause, symptom))
        return Explained(_UNEXPLAINED_RANK, symptom)

    @staticmethod
    def explain_return(symptom: Fault, returned: Fault) -> Explained | None:
        """Return a symptom with its cause, if that is a node that is back after a silence."""
        if symptom.part != returned.part or symptom.code not in _UNHEARD:
            return None
        return Explained(_RETURN_RANK, because(returned, symptom))

    def _dead_bus(self, _: Fault, since_ns: int) -> Fault | None:
        """Return that the bus was off or down."""
        if self._dead is None or self._dead_ns < since_ns:
            return None
        words = self._dead.name.lower().replace("_", " ")
        return Fault(_DEAD[self._dead], f"the CAN bus was {words}")

    def _drive(self, symptom: Fault, since_ns: int) -> Fault | None:
        """Return what the drive said of itself before it fell silent."""
        drive = symptom.part
        if drive == _DRIVE and self._emergency is not None and self._emergency_ns >= since_ns:
            text = f"the motor controller reported {emergency_words(self._emergency)}"
            return Fault(_EMERGENCIES[self._emergency], text, drive)
        supply = self._supplies.get(drive)
        if supply is None or supply.stamp_ns < since_ns:
            return None
        if supply.now_v >= LOW_SHARE * supply.before_v:
            return None
        whose = "the motor controller's supply" if drive == _DRIVE else f"the supply of {drive}"
        text = f"{whose} fell from {supply.before_v:.1f} to {supply.now_v:.1f} V"
        return Fault(FaultCode.DRIVE_UNDER_VOLTAGE, text, drive)

    def _errors_of_bus(self, _: Fault, since_ns: int) -> Fault | None:
        """Return that frames were destroyed on the bus."""
        errors = max(self._errors, self._errors_before)
        frames = f"({errors} error frames)"
        if self._passive_ns >= since_ns:
            return Fault(FaultCode.BUS_PASSIVE, f"the CAN bus is error passive {frames}")
        if self._errors_ns < since_ns or errors < ERRORS:
            return None
        return Fault(FaultCode.BUS_ERRORS, f"the CAN bus has errors {frames}")

    def _no_traffic(self, now_ns: int) -> Fault | None:
        """Return that nothing comes from the bus, or goes onto it."""
        silent_ns = now_ns - self._received_ns
        if silent_ns < SILENT_NS or not self._bus.received:
            return None
        silent = f"nothing has come from the CAN bus for {silent_ns / 1e6:.0f} ms"
        if now_ns - self._refused_ns < TOGETHER_NS:
            text = f"the CAN bus is blocked: {silent}, and it takes nothing of this computer"
            return Fault(FaultCode.BUS_BLOCKED, text)
        return Fault(FaultCode.BUS_SILENT, silent)


def because(cause: Fault, symptom: Fault) -> Fault:
    """Return a cause together with what it led to."""
    return Fault(cause.code, f"{cause.text}: {symptom}", cause.part)
