"""The control core: everything between feedback and command, as one pure step.

`ControlCore.step` reads no clock, does no I/O and draws no random number, so the recorded inputs
of a run give its outputs again bit for bit.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from robotctl.control.limiter import LimitsConfig
from robotctl.control.speed_wheel import SpeedWheel
from robotctl.control.wheel_loop import WheelLoop
from robotctl.control.wheels import WheelControl
from robotctl.core.config import ControlConfig, fastest_wheel_rad_s, impossible_wheel_rad_s
from robotctl.core.control_state import control_state
from robotctl.core.driving import STOPPED, Driving
from robotctl.core.motion import EncoderMotion
from robotctl.core.motor_test import problem
from robotctl.core.procedures import Procedures
from robotctl.core.tuner import Tuner
from robotctl.messages.actuators import ActuatorCommand
from robotctl.messages.control import (
    Arm,
    ControlRequest,
    ControlState,
    EmergencyStop,
    EmergencyStopSource,
    Feedback,
    LoopStatistics,
    Notice,
    SafetyState,
    Severity,
    VelocityCommand,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.procedures import CalibrateGyro, CancelProcedure, MotorTest, Outcome
from robotctl.messages.tuning import Tuning
from robotctl.model.actuators import Actuator, Takes
from robotctl.model.drives.drives import Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.ages import AgeLimit
from robotctl.safety.arm_requests import ArmRequests
from robotctl.safety.command_guard import bounds
from robotctl.safety.monitor import Monitored
from robotctl.safety.node_events import Events, NodeEvents
from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.state_machine import LATCHED, Event, SafetyConfig, SafetyMachine
from robotctl.safety.supervision import Supervision

_AT_REST_M_S = 0.005
_REST: Final = Twist(0.0, 0.0)
_ARMED: Final = SafetyState.ARMED
_MOTOR_TEST: Final = SafetyState.MOTOR_TEST
"""Looking up a member of an enumeration is slow."""
_TESTABLE: Final = frozenset({SafetyState.STANDBY, SafetyState.MOTOR_TEST})
_ENDS_PROCEDURES: Final = frozenset(
    {Event.EMERGENCY_STOP, Event.FAULT, Event.DISARM, Event.ARM, Event.NOT_READY}
)


class Inputs(msgspec.Struct, frozen=True, array_like=True):
    """All that one step depends on, besides the configuration and the steps before.

    `objections` are reasons of the host computer against arming; they count in the tick that
    brings a request to arm.
    """

    feedback: Feedback
    requests: tuple[ControlRequest, ...] = ()
    objections: tuple[Fault, ...] = ()


class Outputs(msgspec.Struct, frozen=True, array_like=True):
    """Outputs of one step."""

    command: ActuatorCommand
    emergency_stop: EmergencyStopSource | None = None
    clear_faults: bool = False
    notices: tuple[Notice, ...] = ()


class ControlCore:
    """The state of the controller between ticks.

    Parameters
    ----------
    drive
        Kinematics.
    actuators
        Its wheels and joints, with the abilities of the motor drives.
    control, limits, safety, plausibility
        Configuration of the wheel loops, of the set-point limiter and of the safety core.
    ages
        How old what the nodes report may be.
    period_ns
        Control period [ns].
    sonars
        The ring, in the order of the bus.
    imu
        Mounting of the IMU, if there is one.
    pose_odom_base
        Where odometry starts.
    """

    def __init__(
        self,
        drive: Drive,
        actuators: tuple[Actuator, ...],
        control: ControlConfig,
        limits: LimitsConfig,
        safety: SafetyConfig,
        plausibility: PlausibilityConfig,
        ages: tuple[AgeLimit, ...],
        period_ns: int,
        sonars: tuple[SonarMount, ...],
        imu: ImuConfig,
        pose_odom_base: SE2,
    ) -> None:
        self.machine = SafetyMachine()
        self.odometer_start_m = 0.0
        """Odometer before this core was created [m]."""
        self.actuators = actuators
        self._drive = drive
        self._safety = safety
        self._wheels = _wheels(actuators, control, impossible_wheel_rad_s(drive, limits))
        self.motion = EncoderMotion(drive, self._wheels, pose_odom_base, imu)
        allowed = bounds(actuators, fastest_wheel_rad_s(drive, limits), drive.joint_max_rad)
        self._driving = Driving(
            drive, self._wheels, limits, allowed, safety.setpoint_timeout_ms, period_ns
        )
        self._tuner = Tuner(control, limits, self._wheels, _duty_wheels(actuators), self._driving)
        monitored = Monitored(
            plausibility,
            actuators,
            control.pwm.deadband,
            drive.joint_max_rad,
            limits.a_max_m_s2 / max(drive.wheel_radii_m),
            sonars,
            imu,
        )
        self._supervision = Supervision(safety, ages, monitored)
        self._health = self._supervision.health
        self._arming = ArmRequests(safety)
        self._procedures = Procedures(drive, actuators, control.pwm, plausibility, period_ns)
        self._node_events = NodeEvents({each.drive for each in actuators})
        self._command = self._command_before = STOPPED
        """This tick's, and that in force when the newest feedback was taken, one period ago."""
        self._restarts: tuple[Fault, ...] = ()
        """Nodes that are back in this tick."""
        self._notices: list[Notice] = []
        self._ticks = self._armings = 0

    @property
    def warm(self) -> bool:
        """Whether the loop has run long enough to be allowed to arm."""
        return self._ticks >= self._safety.warmup_ticks

    def step(self, inputs: Inputs, now_ns: int) -> Outputs:
        """Return the command of this tick; `now_ns` is its time, never read from a clock."""
        self._begin_tick(now_ns)
        self._take_feedback(inputs.feedback, now_ns)
        asked = self._take_requests(inputs, now_ns) if inputs.requests else None
        found = self._supervise(now_ns)
        clear = bool(self._arming.waiting) and self._try_to_arm(now_ns)
        command = self._drive_wheels(now_ns)
        stop = found if asked is None else asked
        return Outputs(command, stop, clear, tuple(self._notices))

    def _begin_tick(self, now_ns: int) -> None:
        """Note that time has passed."""
        self._notices = []
        self._restarts = ()
        self._ticks += 1
        if self._ticks == 1:
            self.motion.epoch_ns = now_ns
        self._health.stalls.step(now_ns)

    def _take_feedback(self, feedback: Feedback, now_ns: int) -> None:
        """Update estimates and monitors from the feedback."""
        feedback = self.motion.update(feedback)
        self._supervision.take(feedback, now_ns)
        if self.machine.powered:
            self._supervision.compare(feedback, self._command_before, self.motion)
        self._procedures.measure(self.motion, now_ns)
        if self.machine.state in _TESTABLE:
            self._procedures.surroundings.watch(self._health.sonars.fresh_m(now_ns), now_ns)
        self._notices += self._supervision.strangers.take_notices(now_ns)
        events = self._node_events.take(feedback, now_ns)
        if events is not None:
            self._take_node_events(events, now_ns)
        if feedback.emergency_stop is not None:
            source = feedback.emergency_stop.name.lower().replace("_", " ")
            text = f"emergency stop on the bus ({source})"
            self._on(Event.EMERGENCY_STOP, Fault(FaultCode.EMERGENCY_STOP_BUS, text), now_ns)

    def _take_node_events(self, events: Events, now_ns: int) -> None:
        """Stop if a node has restarted; the drive's counts restart."""
        if events.drive_booted:
            self.motion.restart(now_ns)
        self._notices += events.notices
        self._restarts = events.restarts
        if events.restarts and self.machine.powered:
            fault = self._supervision.explained(events.restarts[0], now_ns)
            self._on(Event.FAULT, fault, now_ns)

    def _take_requests(self, inputs: Inputs, now_ns: int) -> EmergencyStopSource | None:
        """Carry out requests that are not too old; an emergency stop has no age.

        A stop wins over any request to arm that was made before it, whichever comes first: who
        made it did not know of the stop.
        """
        stop = None
        stopping = inputs.feedback.emergency_stop is not None or any(
            isinstance(request, EmergencyStop) for request in inputs.requests
        )
        for request in inputs.requests:
            match request:
                case VelocityCommand():
                    self._driving.velocity = request
                case Tuning():
                    refusal = self._tuner.take(request)
                    self._notices += () if refusal is None else (refusal,)
                case EmergencyStop():
                    stop = request.source
                    source = request.source.name.lower().replace("_", " ")
                    fault = Fault(FaultCode.EMERGENCY_STOP, f"emergency stop ({source})")
                    self._on(Event.EMERGENCY_STOP, fault, now_ns)
                case CalibrateGyro() | MotorTest():
                    self._begin_procedure(request, inputs.objections, now_ns)
                case CancelProcedure():
                    if request.request_id == self._procedures.latest.request_id:
                        self._end_procedure(Outcome.CANCELLED, "cancelled", now_ns)
                case Arm():
                    self._take_arm(request, inputs.objections, now_ns, stopping=stopping)
        return stop

    def _take_arm(
        self, request: Arm, objections: tuple[Fault, ...], now_ns: int, *, stopping: bool
    ) -> None:
        """Disarm, or let a request to arm wait; that ends any procedure."""
        if not request.arm:
            self._arming.answer_waiting(Fault(FaultCode.REQUEST_WITHDRAWN, "disarmed"))
            self._end_procedure(Outcome.CANCELLED, "disarmed", now_ns)
            self._on(Event.DISARM, "disarmed", now_ns)
            self._arming.answer(request.request_id)
        elif why := self._arming.untimely(request, now_ns, self.machine.reason, stopping=stopping):
            self._arming.answer(request.request_id, why)
        else:
            self._end_procedure(Outcome.CANCELLED, "arming was asked for", now_ns)
            self._arming.wait(request, objections)
            if self.machine.state in LATCHED:
                self._on(Event.RESET, "arming after a stop", now_ns)

    def _begin_procedure(
        self, request: CalibrateGyro | MotorTest, objections: tuple[Fault, ...], now_ns: int
    ) -> None:
        """Begin a calibration or a motor test in place of the last one, unless that is it."""
        procedures = self._procedures
        if procedures.is_known(request):
            return
        self._end_procedure(Outcome.CANCELLED, "something else was asked for", now_ns)
        if why := self._against(request, objections, now_ns):
            procedures.refuse(request, why)
        elif isinstance(request, CalibrateGyro):
            procedures.calibrate(request, now_ns)
        elif self._on(Event.TEST, "motor test", now_ns):
            procedures.begin_test(request, self.motion.joints_rad, now_ns)
            self._take_over(now_ns, wheels_alone=True)

    def _against(
        self, request: CalibrateGyro | MotorTest, objections: tuple[Fault, ...], now_ns: int
    ) -> str:
        """Return what speaks against a procedure, empty if nothing does."""
        if self.machine.powered or self._arming.waiting:
            return "the robot is armed, or about to be"
        if not self.motion.is_at_rest:
            return "the wheels turn"
        if isinstance(request, CalibrateGyro):
            return "" if self._health.is_fresh("gyro", now_ns) else "the gyro is not heard"
        if self.machine.state is not SafetyState.STANDBY:
            return f"the state is {self.machine.state.name}: {self.machine.reason}"
        if why := problem(request, len(self._wheels), now_ns):
            return why
        refusals = self._refusals(now_ns, objections, untuned=True)
        return "; ".join(map(str, refusals)) or self._procedures.surroundings.obstacle

    def _end_procedure(self, outcome: Outcome, why: str, now_ns: int) -> None:
        """End what is under way, at once."""
        self._procedures.end(outcome, why)
        self._on(Event.TEST_OVER, why, now_ns)

    def _supervise(self, now_ns: int) -> EmergencyStopSource | None:
        """Let supervision move the state machine; return why others must stop the drive."""
        if self.machine.powered:
            fault = self._supervision.fault(now_ns)
            if fault is None:
                return None
            self._on(Event.FAULT, fault, now_ns)
        elif self.machine.state is SafetyState.FAULT:
            self._explain_stop(now_ns)
        elif self.machine.state not in LATCHED:
            problem = self._health.node_problem(now_ns)
            if problem is None:
                self._on(Event.READY, "", now_ns)
            elif not self._on(Event.NOT_READY, problem, now_ns):
                self.machine.explain(problem)
        unasked = self._supervision.unasked()
        if unasked is None:
            return None
        self._on(Event.EMERGENCY_STOP, unasked, now_ns)
        return EmergencyStopSource.HOST_FAULT

    def _explain_stop(self, now_ns: int) -> None:
        """Tell the cause of a stop that shows up only now."""
        cause = self._supervision.later_cause(now_ns, self._restarts)
        if cause is not None:
            self.machine.explain(cause)
            text = f"cause of the stop: {cause}"
            self._notices.append(Notice(now_ns, Severity.CRITICAL, text))

    def _try_to_arm(self, now_ns: int) -> bool:
        """Arm if nothing speaks against it; return whether the drive's latches must be cleared."""
        arming = self._arming
        if self.machine.powered:
            arming.answer_waiting()
            return False
        refusals = self._refusals(now_ns, arming.objections)
        if not refusals and self._on(Event.ARM, "", now_ns):
            arming.answer_waiting()
            self._take_over(now_ns)
            return False
        if arming.is_overdue(now_ns):
            refusals = refusals or (Fault(FaultCode.NOT_READY, self.machine.reason),)
            arming.answer_waiting(*refusals)
            text = f"arming refused: {'; '.join(map(str, refusals))}"
            self._notices.append(Notice(now_ns, Severity.WARNING, text))
            return False
        return self._health.drive_latched and arming.may_clear(now_ns)

    def _refusals(
        self, now_ns: int, objections: tuple[Fault, ...], *, untuned: bool = False
    ) -> tuple[Fault, ...]:
        """Return all reasons against arming now; `untuned`: loops without gains are none."""
        refusals = objections if untuned else objections + self._tuner.powerless
        refusals += self._supervision.refusals(
            now_ns, self.motion.speeds_rad_s, self.motion.imu, enabled=self._command_before.enable
        )
        if not self.warm:
            of = self._safety.warmup_ticks
            text = f"the control loop is not warm: tick {self._ticks} of {of}"
            refusals += (Fault(FaultCode.NOT_WARM, text),)
        return refusals

    def _take_over(self, now_ns: int, *, wheels_alone: bool = False) -> None:
        """Begin to supervise and to drive, from the present motion."""
        self._node_events.forget_errors()
        self._supervision.armed(now_ns, wheels_alone=wheels_alone)
        self._driving.take_over(self.motion.twist, now_ns)

    def _drive_wheels(self, now_ns: int) -> ActuatorCommand:
        """Return the command for the present state and velocity set-point."""
        self._command_before = self._command
        self._command = command = self._next_command(now_ns)
        if command.enable:
            self._supervision.powered(now_ns)
        return command

    def _next_command(self, now_ns: int) -> ActuatorCommand:
        """Close the wheel loops where the robot is powered."""
        driving, motion, reports = self._driving, self.motion, self._health.reports
        if self.machine.state is _MOTOR_TEST:
            wheels = reports[: len(self._wheels)]
            supplies_v = tuple([report.voltage_v or 0.0 for report in wheels])
            values = self._procedures.turn(motion, supplies_v, now_ns)
            if values is not None:
                return self._unless_refused(driving.guarded(values), now_ns)
            self._on(Event.TEST_OVER, self._procedures.latest.text, now_ns)
        if not self.machine.powered:
            return driving.stopped()
        if driving.follow_setpoint(motion.twist, now_ns):
            if self.machine.state is _ARMED:
                self._on(Event.MOVE, "", now_ns)
        elif driving.reference == _REST and motion.twist.speed_m_s < _AT_REST_M_S:
            self._on(Event.REST, "", now_ns)
        command = driving.command(motion.joints_rad, reports)
        return self._unless_refused(command, now_ns)

    def _unless_refused(self, command: ActuatorCommand | Fault, now_ns: int) -> ActuatorCommand:
        """Return a command; stop where the command guard has refused it."""
        if isinstance(command, ActuatorCommand):
            return command
        self._on(Event.FAULT, command, now_ns)
        return self._driving.stopped()

    def _on(self, event: Event, why: Fault | str, now_ns: int) -> bool:
        """Apply an event to the state machine and report stops and starts."""
        changed = self.machine.on(event, why)
        self._armings += changed and event is Event.ARM
        if event is Event.EMERGENCY_STOP or (changed and event is Event.FAULT):
            self._arming.stop(now_ns, str(why))
        if changed and event in _ENDS_PROCEDURES:
            self._procedures.end(Outcome.FAILED, str(why) or event.value)
        if changed and event in (Event.EMERGENCY_STOP, Event.FAULT):
            self._driving.velocity = None
            self._notices.append(Notice(now_ns, Severity.CRITICAL, f"stopped: {why}"))
        elif changed and event in (Event.ARM, Event.DISARM, Event.READY):
            text = {"arm accepted": "armed", "all nodes ready": "ready to arm"}
            line = text.get(event.value, "disarmed")
            self._notices.append(Notice(now_ns, Severity.INFORMATION, line))
        elif changed and event is Event.NOT_READY:
            self._notices.append(Notice(now_ns, Severity.WARNING, f"not ready: {why}"))
        return changed

    def snapshot(
        self, now_ns: int, loop: LoopStatistics, objections: tuple[Fault, ...] = ()
    ) -> ControlState:
        """Return the state for other processes; `objections` are the host's to arming."""
        reference = self._driving.reference
        return control_state(
            self.machine,
            self._health,
            self.motion,
            self._wheels,
            self._drive,
            now_ns,
            v_ref_m_s=reference.v_m_s,
            omega_ref_rad_s=reference.omega_rad_s,
            vy_ref_m_s=reference.vy_m_s,
            duty=self._duties(),
            loop=loop,
            odometer_m=self.odometer_start_m + self.motion.odometry.distance_m,
            acks=self._arming.acks,
            armings=self._armings,
            against_arming=() if self.machine.powered else self._refusals(now_ns, objections),
            tuning=self._tuner.number,
            procedure=self._procedures.latest,
            stopped_ns=self._arming.stopped_ns,
        )

    def _duties(self) -> tuple[float, ...]:
        """Return the duty that is commanded to each wheel [-1, 1]; nan: its drive has a loop."""
        n = len(self._wheels)
        values = zip(self.actuators[:n], self._command.values or (0.0,) * n, strict=False)
        return tuple([value if each.takes is Takes.DUTY else math.nan for each, value in values])


def _wheels(
    actuators: tuple[Actuator, ...], control: ControlConfig, impossible_rad_s: float
) -> tuple[WheelControl, ...]:
    """Return what turns references into commands, for each wheel."""
    loops = iter(control.loops(_duty_wheels(actuators)))
    wheels: list[WheelControl] = []
    for each in actuators:
        ticks = each.ticks_per_revolution
        if each.takes is Takes.DUTY:
            wheels.append(WheelLoop(next(loops), control.pwm, ticks, impossible_rad_s))
        elif each.takes is Takes.SPEED:
            wheels.append(SpeedWheel(ticks, impossible_rad_s))
    return tuple(wheels)


def _duty_wheels(actuators: tuple[Actuator, ...]) -> tuple[str, ...]:
    """Return the names of the wheels whose drives take a duty."""
    return tuple(each.name for each in actuators if each.takes is Takes.DUTY)
