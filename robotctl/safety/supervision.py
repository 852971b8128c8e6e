"""Supervision: whether the robot may continue, judged by its inputs alone and together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.messages.control import DriveState, Feedback, ImuFeedback, WheelCommand
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.causes import AFTER_NS, STRANGER_RANK, Causes, because
from robotctl.safety.health import AgeLimit, Health
from robotctl.safety.monitor import Monitor, Monitored, MonitorInputs, Motion
from robotctl.safety.plausibility import Plausibility
from robotctl.safety.plausibility_imu import ImuMonitor
from robotctl.safety.plausibility_sonar import SonarMonitor
from robotctl.safety.plausibility_values import SensorValues
from robotctl.safety.state_machine import SafetyConfig
from robotctl.safety.strangers import Strangers

_UNASKED_NS: Final = 50_000_000
"""Grace period for the drive to report power off after a stop of the host [ns]."""


def _plausibility(robot: Monitored) -> Plausibility:
    return Plausibility(
        robot.plausibility,
        robot.wheel_names,
        robot.deadband,
        robot.steering_max_rad,
        robot.a_max_rad_s2,
    )


def _sonars(robot: Monitored) -> SonarMonitor:
    return SonarMonitor(robot.sonars, robot.plausibility.travel_m)


def _imu(robot: Monitored) -> ImuMonitor:
    return ImuMonitor(robot.imu)


MONITORS: Final[tuple[Callable[[Monitored], Monitor], ...]] = (_plausibility, _sonars, _imu)
"""All monitors; if several report in the same tick, the first wins, which is the wheels'."""


class Supervision:
    """Health and monitors of one robot.

    Parameters
    ----------
    safety
        Time-outs.
    ages
        How old what the nodes report may be.
    robot
        What is monitored.
    """

    def __init__(self, safety: SafetyConfig, ages: tuple[AgeLimit, ...], robot: Monitored) -> None:
        names = tuple(mount.name for mount in robot.sonars)
        self.health = Health(ages, safety.heartbeat_timeout_ms * 1_000_000, names)
        self.strangers = Strangers()
        self._causes = Causes()
        self._symptom: Fault | None = None
        """What the robot has stopped for, as long as a cause may yet show up."""
        self._stopped_ns = self._rank = 0
        """When it has, and how near to the root its reason is (`Explained`)."""
        self._monitors = tuple(make(robot) for make in MONITORS)
        self._watching = self._monitors
        self._values = SensorValues(
            robot.wheel_names, robot.steering_max_rad, robot.plausibility.steering_tolerance_rad
        )
        self._inertial = ImuMonitor(robot.imu)
        """Judges a robot that is to be armed."""
        self._contradiction: Fault | None = None
        """The first since the robot was armed."""
        self._unasked_limit_ns = safety.command_timeout_ms * 1_000_000 + _UNASKED_NS
        self._powered_ns = 0
        """Time of the last command that allows power [ns]."""

    def take(self, feedback: Feedback, now_ns: int) -> None:
        """Take the inputs of one tick."""
        self.health.update(feedback)
        self.strangers.take(feedback.strangers, now_ns)
        self._causes.take(feedback, now_ns)

    def compare(self, feedback: Feedback, command: WheelCommand, motion: Motion) -> None:
        """Pass the inputs to the monitors while the robot is powered."""
        drive = self.health.drive
        supply_v = None if drive is None else drive.bus_voltage_v
        inputs = MonitorInputs(feedback, command, supply_v, motion)
        for monitor in self._watching:
            found = monitor.update(inputs)
            if found is not None and self._contradiction is None:
                self._contradiction = found

    def fault(self, now_ns: int) -> Fault | None:
        """Return why a powered robot must stop now, or None."""
        fault = self.health.fault(now_ns)
        stranger = self.strangers.fault(now_ns)
        # Where a stranger's NMT frame put a node out of service, that says more.
        if stranger is not None and not (fault and fault.code is FaultCode.NODE_PUT_OUT):
            fault = stranger
            self.strangers.told()
        if fault is None and self._contradiction:
            # Wheels that did not get the command do otherwise.
            fault = self.health.command_loss(now_ns) or self._contradiction
        return None if fault is None else self.explained(fault, now_ns)

    def explained(self, symptom: Fault, now_ns: int) -> Fault:
        """Return a fault that stops the robot now, with its cause as far as that is known."""
        self._symptom, self._stopped_ns = symptom, now_ns
        self._rank, fault = self._causes.explain(symptom, now_ns, now_ns)
        return fault

    def later_cause(self, now_ns: int) -> Fault | None:
        """Return a cause of the last stop that is nearer to the root than what is known so far."""
        if self._symptom is None:
            return None
        if now_ns - self._stopped_ns > AFTER_NS:
            self._symptom = None
            return None
        rank, fault = self._causes.explain(self._symptom, self._stopped_ns, now_ns)
        stranger = self.strangers.fault(now_ns)
        if stranger is not None and self._causes.is_symptom(self._symptom):
            rank, fault = STRANGER_RANK, because(stranger, self._symptom)
            self.strangers.told()
        if rank >= self._rank:
            return None
        self._rank = rank
        return fault

    def unasked(self) -> Fault | None:
        """Return a fault if the drive reports power long after its last command to."""
        # Seen after old commands that a CAN controller delayed. Its time-out has passed, so lost
        # commands are no excuse.
        motor = self.health.motor
        if motor is None or motor.state is not DriveState.ENABLED:
            return None
        if motor.stamp_ns - self._powered_ns <= self._unasked_limit_ns:
            return None
        text = "emergency stop: the motor controller is enabled without a command"
        return Fault(FaultCode.DRIVES_UNASKED, text)

    def powered(self, now_ns: int) -> None:
        """Note that the command of this tick allows power."""
        self._powered_ns = now_ns

    def armed(self, now_ns: int, *, wheels_alone: bool = False) -> None:
        """Note that the robot is armed: the monitors restart.

        `wheels_alone`: only those of the wheels. In a motor test they may turn in the air, which
        contradicts what sonars and IMU say of the robot.
        """
        self._watching = self._monitors[:1] if wheels_alone else self._monitors
        self.health.armed(now_ns)
        self._contradiction = None
        for monitor in self._monitors:
            monitor.reset()

    def refusals(
        self,
        now_ns: int,
        speeds_rad_s: tuple[float, ...],
        imu: ImuFeedback | None,
        *,
        enabled: bool,
    ) -> tuple[Fault, ...]:
        """Return all reasons against arming now; speeds by the encoders [rad/s]."""
        health = self.health
        motor, drive, battery = health.motor, health.drive, health.battery
        refusals = health.refusals(now_ns)
        if (stranger := self.strangers.fault(now_ns)) is not None:
            refusals = (stranger, *refusals)
        if imu is not None and (found := self._inertial.judge(imu)) is not None:
            refusals = (*refusals, found)
        if motor is None or drive is None or battery is None:
            return refusals
        return refusals + self._values.faults(motor, drive, battery, speeds_rad_s, enabled=enabled)
