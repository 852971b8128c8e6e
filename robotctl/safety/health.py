"""The control core's view of its inputs: the newest of each, its age, and reasons to stop."""

from __future__ import annotations

from typing import Final

from robotctl.messages.actuators import NEVER_NS, ActuatorFeedback
from robotctl.messages.control import BatteryFeedback, BusState, BusStatus, Feedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.actuators import Actuator, Takes
from robotctl.safety.ages import AgeLimit, is_fresh
from robotctl.safety.drive_health import ACTUATOR_AGES, DriveHealth
from robotctl.safety.node_health import NodeHealth
from robotctl.safety.sonar_health import SonarHealth
from robotctl.safety.stall import StallWatch

BUS_LOAD_MAX: Final = 0.8
"""Bus load above which the least urgent frames, the node services, are delayed without bound."""

_KEPT: Final = frozenset({*ACTUATOR_AGES, "battery", "sonars"})
"""Inputs that `Health` judges by more than their age."""
_DEAD_BUS_STATES: Final = {
    BusState.BUS_OFF: FaultCode.BUS_OFF,
    BusState.DOWN: FaultCode.BUS_DOWN,
}


class Health:
    """Keeps the newest inputs and judges them.

    Parameters
    ----------
    ages
        How old what the nodes report may be: at least the three of each drive, and the battery's.
    heartbeat_limit_ns
        How old a node's heartbeat may be [ns].
    actuators
        Those of the robot.
    sonars
        Names of the sonars of the ring; empty if none is used.

    Attributes
    ----------
    drives, sonars, nodes, stalls
        Judges of a part of the inputs each, and of this process.
    reports
        Newest of all actuators; empty before the first.
    battery, bus
        Newest of each.
    """

    def __init__(
        self,
        ages: tuple[AgeLimit, ...],
        heartbeat_limit_ns: int,
        actuators: tuple[Actuator, ...],
        sonars: tuple[str, ...] = (),
    ) -> None:
        self.drives = _drives(ages, actuators)
        self._ages = {age.field: age for age in ages if age.field not in ACTUATOR_AGES}
        self.sonars = SonarHealth(sonars, self._ages["sonars"] if sonars else None)
        self.nodes = NodeHealth(heartbeat_limit_ns)
        stall_ns = min(age.limit_ns for age in ages if age.field == "motion")
        self.stalls = StallWatch(stall_ns, (age.code for age in ages))
        self._others = [age for age in ages if age.field not in _KEPT]
        """Inputs judged by age alone,"""
        self._others_ns = dict.fromkeys((age.field for age in self._others), NEVER_NS)
        """and when the newest of each came [ns]."""
        self.reports: tuple[ActuatorFeedback, ...] = ()
        self.battery: BatteryFeedback | None = None
        self._battery_limit_ns = self._ages["battery"].limit_ns
        self.bus = BusStatus()
        self._bus_fault: Fault | None = None

    def update(self, feedback: Feedback) -> None:
        """Take the inputs of one tick."""
        if feedback.actuators:
            self.reports = feedback.actuators
            for drive in self.drives:
                drive.update(feedback.actuators)
        if feedback.battery is not None:
            self.battery = feedback.battery
        if feedback.sonars:
            self.sonars.update(feedback.sonars)
        if self._others:
            self._take_others(feedback)
        if feedback.nodes is not self.nodes.nodes:
            self.nodes.update(feedback.nodes)
        self._take_bus(feedback.bus)

    def _take_others(self, feedback: Feedback) -> None:
        """Note when the inputs judged by age alone last arrived."""
        for age in self._others:
            value = getattr(feedback, age.field)
            if value is not None:
                self._others_ns[age.field] = value.stamp_ns

    def _take_bus(self, bus: BusStatus) -> None:
        """Keep the state of the bus, and the fault that it is."""
        if bus is self.bus:
            return
        self.bus = bus
        code = _DEAD_BUS_STATES.get(bus.state)
        self._bus_fault = None
        if code is not None:
            self._bus_fault = Fault(code, f"the CAN bus is {_words(bus.state)}")

    def wheels_fresh(self, now_ns: int) -> bool:
        """Return whether the motion of all wheels is not too old."""
        return all(drive.moves_fresh(now_ns) for drive in self.drives)

    def reports_fresh(self, now_ns: int) -> bool:
        """Return whether the reports of state, current and temperature are not too old."""
        return all(drive.reports_fresh(now_ns) for drive in self.drives)

    def is_fresh(self, field: str, now_ns: int) -> bool:
        """Return whether inputs judged by age alone have arrived and are fresh."""
        stamp_ns = self._others_ns.get(field)
        return stamp_ns is not None and is_fresh(stamp_ns, now_ns, self._ages[field].limit_ns)

    def fresh_battery(self, now_ns: int) -> BatteryFeedback | None:
        """Return the battery's report if it is not too old."""
        battery = self.battery
        fresh = battery is not None and is_fresh(battery.stamp_ns, now_ns, self._battery_limit_ns)
        return battery if fresh else None

    def command_loss(self, now_ns: int) -> Fault | None:
        """Return a fault if a drive reports that no command reached it."""
        lost = [drive.command_loss(now_ns) for drive in self.drives]
        return next(filter(None, lost), None)

    def node_problem(self, now_ns: int) -> Fault | None:
        """Return the fault that keeps a node out of service, or None if all are in service."""
        problems = self.nodes.faults(now_ns)
        return problems[0] if problems else None

    def fault(self, now_ns: int) -> Fault | None:
        """Return why a powered robot must stop now, or None."""
        faults = self._faults(now_ns)
        if faults:
            return self.stalls.explained(faults[0], now_ns)
        for drive in self.drives:
            if disobeys := drive.disobeys():
                return self.command_loss(now_ns) or disobeys
        return None

    def armed(self, now_ns: int) -> None:
        """Take note that the robot is armed: from now on the drives are to be enabled."""
        for drive in self.drives:
            drive.armed(now_ns)

    def refusals(self, now_ns: int) -> tuple[Fault, ...]:
        """Return all reasons against arming at this moment."""
        reasons = self._faults(now_ns)
        battery, bus = self.battery, self.bus
        reasons += filter(None, [drive.loses_commands(now_ns) for drive in self.drives])
        # The reasons below prevent arming but do not stop a robot that already drives.
        if battery is not None and battery.low and not battery.critical:
            text = f"the battery is low ({battery.voltage_v:.1f} V)"
            reasons.append(Fault(FaultCode.BATTERY_LOW, text))
        if bus.state == BusState.ERROR_PASSIVE:
            reasons.append(Fault(FaultCode.BUS_PASSIVE, "the CAN bus is error passive"))
        if bus.load > BUS_LOAD_MAX:
            text = f"the CAN bus is {bus.load:.0%} full, {BUS_LOAD_MAX:.0%} allowed"
            reasons.append(Fault(FaultCode.BUS_FULL, text))
        return tuple(reasons)

    def _faults(self, now_ns: int) -> list[Fault]:
        """Return all reasons to stop, the most telling first."""
        faults = []
        if self._bus_fault is not None:
            faults.append(self._bus_fault)
        for drive in self.drives:
            faults += drive.faults(now_ns)
        faults += self._battery_faults(now_ns)
        faults += self.sonars.faults(now_ns)
        for age in self._others:
            if not is_fresh(self._others_ns[age.field], now_ns, age.limit_ns):
                faults.append(age.fault())
        faults += self.nodes.faults(now_ns)
        return faults

    def _battery_faults(self, now_ns: int) -> list[Fault]:
        """Return the battery's faults."""
        battery = self.battery
        if battery is None:
            return [Fault(FaultCode.BATTERY_MISSING, "the battery has not reported yet")]
        if not is_fresh(battery.stamp_ns, now_ns, self._battery_limit_ns):
            return [self._ages["battery"].fault()]
        if battery.critical:
            text = f"the battery is critical ({battery.voltage_v:.1f} V)"
            return [Fault(FaultCode.BATTERY_CRITICAL, text)]
        return []

    @property
    def drive_latched(self) -> bool:
        """Whether a motor drive waits for its faults to be cleared."""
        return any(drive.latched for drive in self.drives)


def _drives(ages: tuple[AgeLimit, ...], actuators: tuple[Actuator, ...]) -> tuple[DriveHealth, ...]:
    """Return the drives of a robot, in the order of its actuators."""
    found = []
    for name in dict.fromkeys(each.drive for each in actuators):
        places = [index for index, each in enumerate(actuators) if each.drive == name]
        joints = tuple(i for i in places if actuators[i].takes is Takes.ANGLE)
        wheels = tuple(i for i in places if i not in joints)
        limits = {age.field: age for age in ages if age.part == name}
        found.append(DriveHealth(name, wheels, joints, limits))
    return tuple(found)


def _words(state: BusState) -> str:
    """Write a state of the bus for people."""
    return state.name.lower().replace("_", " ")
