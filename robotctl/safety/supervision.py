"""Supervision: whether the robot may continue, judged by its inputs alone and together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import Feedback, ImuFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.ages import AgeLimit
from robotctl.safety.causes import AFTER_NS, RETURN_NS, STRANGER_RANK, Causes, Explained, because
from robotctl.safety.health import Health
from robotctl.safety.monitor import Monitor, Monitored, MonitorInputs, Motion
from robotctl.safety.plausibility import Plausibility
from robotctl.safety.plausibility_imu import ImuMonitor
from robotctl.safety.plausibility_sonar import SonarMonitor
from robotctl.safety.plausibility_values import SensorValues
from robotctl.safety.state_machine import SafetyConfig
from robotctl.safety.strangers import Strangers

_UNASKED_NS: Final = 50_000_000
"""Grace period for the drive to report power off after a stop of the host [ns]."""


def _sonars(robot: Monitored) -> SonarMonitor:
    return SonarMonitor(robot.sonars, robot.plausibility.travel_m)


def _imu(robot: Monitored) -> ImuMonitor:
    return ImuMonitor(robot.imu)


MONITORS: Final[tuple[Callable[[Monitored], Monitor], ...]] = (Plausibility, _sonars, _imu)
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
        self.health = Health(ages, safety.heartbeat_timeout_ms * 1_000_000, robot.actuators, names)
        self.strangers = Strangers()
        self._causes = Causes(robot.actuators)
        self._symptom: Fault | None = None
        """Fault that the robot has stopped for, as long as a cause may yet show up."""
        self._stopped_ns = self._rank = 0
        """When it has, and how near to the root its reason is (`Explained`)."""
        self._monitors = tuple(make(robot) for make in MONITORS)
        self._watching = self._monitors
        self._values = SensorValues(
            robot.actuators, robot.joint_max_rad, robot.plausibility.steering_tolerance_rad
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

    def compare(self, feedback: Feedback, command: ActuatorCommand, motion: Motion) -> None:
        """Pass the inputs to the monitors while the robot is powered."""
        inputs = MonitorInputs(feedback, command, motion)
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

    def later_cause(self, now_ns: int, restarts: tuple[Fault, ...] = ()) -> Fault | None:
        """Return a cause of the last stop that is nearer to the root than what is known so far.

        Parameters
        ----------
        now_ns
            Present time [ns].
        restarts
            Nodes that are back in this tick.
        """
        symptom = self._symptom
        if symptom is None:
            return None
        if now_ns - self._stopped_ns > RETURN_NS:
            self._symptom = None
            return None
        returns = [self._causes.explain_return(symptom, each) for each in restarts]
        found = [each for each in (*returns, self._late_cause(symptom, now_ns)) if each is not None]
        nearest = min(found, key=lambda each: each.rank, default=None)
        if nearest is None or nearest.rank >= self._rank:
            return None
        self._rank = nearest.rank
        return nearest.fault

    def _late_cause(self, symptom: Fault, now_ns: int) -> Explained | None:
        """Return a symptom with the cause that its inputs prove; None when it is too late."""
        if now_ns - self._stopped_ns > AFTER_NS:
            return None
        stranger = self.strangers.fault(now_ns)
        if stranger is not None and self._causes.is_symptom(symptom):
            self.strangers.told()
            return Explained(STRANGER_RANK, because(stranger, symptom))
        return self._causes.explain(symptom, self._stopped_ns, now_ns)

    def unasked(self) -> Fault | None:
        """Return a fault if a drive reports power long after its last command to."""
        # Seen after old commands that a CAN controller delayed. Its time-out has passed, so lost
        # commands are no excuse.
        for drive in self.health.drives:
            enabled_ns = drive.enabled_ns
            if enabled_ns is not None and enabled_ns - self._powered_ns > self._unasked_limit_ns:
                text = "emergency stop: the motor controller is enabled without a command"
                return Fault(FaultCode.DRIVES_UNASKED, text, drive.name)
        return None

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
        self._contradiction = self._symptom = None
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
        reports, battery = health.reports, health.battery
        refusals = health.refusals(now_ns)
        if (stranger := self.strangers.fault(now_ns)) is not None:
            refusals = (stranger, *refusals)
        if imu is not None and (found := self._inertial.judge(imu)) is not None:
            refusals = (*refusals, found)
        if not reports or battery is None:
            return refusals
        return refusals + self._values.faults(reports, battery, speeds_rad_s, enabled=enabled)
