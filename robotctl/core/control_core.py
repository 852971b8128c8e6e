"""The control core: everything between feedback and command, as one pure step.

`ControlCore.step` reads no clock, does no I/O and draws no random number, so the recorded inputs
of a run give its outputs again bit for bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import msgspec

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.control.pid import PidConfig
from robotctl.control.pwm import PwmConfig
from robotctl.control.wheel_loop import WheelLoop
from robotctl.core.motion import EncoderMotion
from robotctl.estimation.odometry.odometry import Odometry
from robotctl.messages.control import (
    Arm,
    ControlRequest,
    ControlState,
    EmergencyStop,
    EmergencyStopSource,
    Feedback,
    LoopStatistics,
    NodeStatus,
    Notice,
    SafetyState,
    Severity,
    VelocityCommand,
    WheelCommand,
    WheelFeedback,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.drives.drives import DifferentialDrive, Drive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.arm_requests import ArmRequests
from robotctl.safety.command_guard import guard_command
from robotctl.safety.health import AgeLimit
from robotctl.safety.node_events import NodeEvents
from robotctl.safety.plausibility import PlausibilityConfig
from robotctl.safety.stale_frame_filter import Latch, LatchTimes
from robotctl.safety.state_machine import LATCHED, Event, SafetyConfig, SafetyMachine
from robotctl.safety.supervision import Monitored, Supervision

_UNKNOWN_TWIST: Final = Twist(math.nan, math.nan)
_AT_REST_M_S = 0.005
_CLEAR_INTERVAL_NS = 100_000_000
_DRIVE_NODE = 1
_IMPOSSIBLE_SHARE = 2.0
"""No wheel turns faster than so many times its speed at the robot's limits, and being pushed."""
_PUSHED_M_S = 1.5
"""How fast people push or carry a robot [m/s]."""


@dataclass(frozen=True, slots=True)
class ControlConfig:
    """Wheel loops: `left` and `right` for a differential drive, `drive` for drive-and-steer."""

    pwm: PwmConfig = field(default_factory=PwmConfig)
    left: PidConfig | None = None
    right: PidConfig | None = None
    drive: PidConfig | None = None

    def loops(self, wheel_names: tuple[str, ...]) -> tuple[PidConfig, ...]:
        """Return the loops of the named wheels.

        Raises
        ------
        ValueError
            Where one is missing, or one is given for a wheel that the drive has not.
        """
        if problems := self.wrong_loops(wheel_names):
            raise ValueError("\n".join(f"control.{name}: {why}" for name, why in problems))
        given = self._loops()
        return tuple(loop for name in wheel_names if (loop := given[name]) is not None)

    def wrong_loops(self, wheel_names: tuple[str, ...]) -> list[tuple[str, str]]:
        """Return which loops are missing or too many for the named wheels, each with the reason."""
        given, wheels = self._loops(), ", ".join(wheel_names)
        return [
            (name, f"missing, this drive has the wheels {wheels}")
            for name in wheel_names
            if given[name] is None
        ] + [
            (name, f"this drive has no such wheel, only {wheels}")
            for name, loop in given.items()
            if loop is not None and name not in wheel_names
        ]

    def _loops(self) -> dict[str, PidConfig | None]:
        return {"left": self.left, "right": self.right, "drive": self.drive}


class Inputs(msgspec.Struct, frozen=True, array_like=True):
    """All that one step depends on, besides the configuration and the steps before.

    `objections` are reasons of the host computer against arming; they count in the tick that
    brings a request to arm.
    """

    feedback: Feedback
    requests: tuple[ControlRequest, ...] = ()
    objections: tuple[Fault, ...] = ()


class Outputs(msgspec.Struct, frozen=True, array_like=True):
    """What one step wants done."""

    command: WheelCommand
    emergency_stop: EmergencyStopSource | None = None
    clear_faults: bool = False
    notices: tuple[Notice, ...] = ()


class ControlCore:
    """The state of the controller between ticks.

    Parameters
    ----------
    drive
        Kinematics.
    control, limits, safety, plausibility
        Configuration of the wheel loops, of the set-point limiter and of the safety core.
    ages
        How old what the nodes report may be.
    period_ns
        Control period [ns].
    sonars
        The ring, in the order of the bus.
    pose_world_base
        Where odometry starts.
    """

    def __init__(
        self,
        drive: Drive,
        control: ControlConfig,
        limits: LimitsConfig,
        safety: SafetyConfig,
        plausibility: PlausibilityConfig,
        ages: tuple[AgeLimit, ...],
        period_ns: int,
        sonars: tuple[SonarMount, ...],
        pose_world_base: SE2,
    ) -> None:
        self.machine = SafetyMachine()
        self.odometry = Odometry(drive, pose_world_base)
        self.odometer_start_m = 0.0
        """What the robot had driven in its life before this core was made [m]."""
        self._drive = drive
        impossible_rad_s = impossible_wheel_rad_s(drive, limits)
        loops = control.loops(drive.wheel_names)
        self._wheels = tuple(
            WheelLoop(pid, control.pwm, drive.counts_per_revolution, impossible_rad_s)
            for pid in loops
        )
        self._powerless = tuple(
            Fault(
                FaultCode.NO_GAINS,
                f"control.{name}: kp, ki and kv are 0, the wheel would not turn: find gains with "
                "`robotctl tune`",
                name,
            )
            for name, pid in zip(drive.wheel_names, loops, strict=True)
            if not pid.can_drive
        )
        """Reasons against arming that a file cannot be refused for: it may be one to be tuned."""
        self._estimators = self._wheels[0].estimator, self._wheels[-1].estimator
        self._limiter = TwistLimiter(limits)
        self._safety = safety
        self._setpoint_limit_ns = safety.setpoint_timeout_ms * 1_000_000
        self._period_s = period_ns * 1e-9
        self._command = WheelCommand(enable=False, brake=True)
        self._steering_max_rad = (
            0.0 if isinstance(drive, DifferentialDrive) else drive.steering_max_rad
        )
        self._motion = EncoderMotion(self._wheels, self.odometry)
        self._supervision = Supervision(
            safety,
            ages,
            Monitored(
                plausibility,
                drive.wheel_names,
                control.pwm.deadband,
                self._steering_max_rad,
                limits.a_max_m_s2 / max(drive.wheel_radii_m),
                sonars,
            ),
        )
        self._health = self._supervision.health
        self._command_before = self._command
        """What the bridges did when the newest feedback was taken, one period ago."""
        self._velocity: VelocityCommand | None = None
        self._twist_meas = Twist(0.0, 0.0)
        self._twist_ref = Twist(0.0, 0.0)
        self._steering_rad = 0.0
        self._has_counts = False
        self._latches = LatchTimes()
        self._node_events = NodeEvents()
        self._ticks = 0
        self._arming = ArmRequests()
        self._objections: tuple[Fault, ...] = ()
        self._cleared_ns = 0
        self._stopped_ns = 0
        """Time of the last emergency stop or fault [ns]."""
        self._armed_ns = 0
        """Time of the last arming [ns]."""
        self._notices: list[Notice] = []
        self._armings = 0
        self._odom_epoch_ns = 0
        """Time of the first step, or of the last restart of the drive since [ns]."""

    @property
    def warm(self) -> bool:
        """Whether the loop has run long enough to be allowed to arm."""
        return self._ticks >= self._safety.warmup_ticks

    def step(self, inputs: Inputs, now_ns: int) -> Outputs:
        """Return the command of this tick; `now_ns` is its time, never read from a clock."""
        self._notices = []
        self._ticks += 1
        if self._ticks == 1:
            self._odom_epoch_ns = now_ns
        self._health.step(now_ns)
        self._take_feedback(inputs.feedback, now_ns)
        stop = None
        if inputs.requests or inputs.feedback.emergency_stop is not None:
            stop = self._take_requests(inputs, now_ns)
        if self._supervise(now_ns) and stop is None:
            stop = EmergencyStopSource.HOST_FAULT
        clear = bool(self._arming.waiting) and self._try_to_arm(now_ns)
        self._command_before = self._command
        self._command = self._drive_wheels(now_ns)
        if self._command.enable:
            self._supervision.powered(now_ns)
        return Outputs(self._command, stop, clear, tuple(self._notices))

    def _take_feedback(self, feedback: Feedback, now_ns: int) -> None:
        """Update estimates from what the bus brought."""
        health = self._health
        wheels = feedback.wheels
        latch = Latch.NEXT if wheels is None else self._latches.judge(wheels)
        if latch is Latch.HELD_BACK:
            wheels = None
            feedback = msgspec.structs.replace(feedback, wheels=None)
        health.update(feedback)
        if feedback.drive is not None:
            self._steering_rad = feedback.drive.steering_rad
        if wheels is not None:
            self._take_counts(wheels, anew=latch is Latch.ANEW)
        if self.machine.powered:
            self._supervision.compare(feedback, self._command_before, self._motion)
        for node, was_up in self._node_events.booted(feedback):
            self._take_boot(node, now_ns, was_up=was_up)
        for emergency in feedback.emergencies:
            if text := self._node_events.error(emergency):
                self._notices.append(Notice(now_ns, Severity.WARNING, text))
        if feedback.emergency_stop is not None:
            source = feedback.emergency_stop.name.lower().replace("_", " ")
            text = f"emergency stop on the bus ({source})"
            self._on(Event.EMERGENCY_STOP, Fault(FaultCode.EMERGENCY_STOP_BUS, text), now_ns)

    def _take_counts(self, wheels: WheelFeedback, *, anew: bool) -> None:
        """Update velocities and odometry; `anew`: behind a gap of unknown length."""
        counts = wheels.count1, wheels.count2
        for wheel, count in zip(self._wheels, counts, strict=False):  # of a single one the first
            if not self._has_counts:
                wheel.estimator.reset(count, wheels.timestamp_us)
            elif anew:
                wheel.estimator.resume(count, wheels.timestamp_us)
            wheel.estimator.update(count, wheels.timestamp_us)
        self._has_counts = True
        first, last = self._estimators
        self.odometry.update(first.position_rad, last.position_rad, self._steering_rad)
        self._twist_meas = self._drive.forward(
            first.velocity_rad_s, last.velocity_rad_s, self._steering_rad
        )

    def _take_boot(self, node: NodeStatus, now_ns: int, *, was_up: bool) -> None:
        """Stop where a node has restarted; the counts of the drive begin anew."""
        if node.node_id == _DRIVE_NODE:
            self._has_counts = False
            self._latches.reset()
            self.odometry.reset(0.0, 0.0)
            self._odom_epoch_ns = now_ns
        if was_up and node.node_id == _DRIVE_NODE:
            text = "the drive restarted or was silent: its motion meanwhile is not in the pose"
            self._notices.append(Notice(now_ns, Severity.WARNING, text))
        if was_up and self.machine.powered:
            text = f"{node.name} (node {node.node_id}) restarted"
            self._on(Event.FAULT, Fault(FaultCode.NODE_RESTARTED, text, node.name), now_ns)

    def _take_requests(self, inputs: Inputs, now_ns: int) -> EmergencyStopSource | None:
        """Carry out requests that are not too old; an emergency stop has no age.

        A stop wins over any request to arm that was made before it, whichever comes first: who
        made it did not know of the stop.
        """
        stop = None
        stopping = inputs.feedback.emergency_stop is not None or any(
            isinstance(request, EmergencyStop) for request in inputs.requests
        )
        oldest_ns = now_ns - self._safety.request_max_age_ms * 1_000_000
        for request in inputs.requests:
            match request:
                case VelocityCommand():
                    self._velocity = request
                case EmergencyStop():
                    stop = request.source
                    source = request.source.name.lower().replace("_", " ")
                    fault = Fault(FaultCode.EMERGENCY_STOP, f"emergency stop ({source})")
                    self._on(Event.EMERGENCY_STOP, fault, now_ns)
                case Arm(arm=False):
                    self._arming.answer_waiting(Fault(FaultCode.REQUEST_WITHDRAWN, "disarmed"))
                    self._on(Event.DISARM, "disarmed", now_ns)
                    self._arming.answer(request.request_id)
                case Arm() if request.stamp_ns < oldest_ns:
                    too_old = Fault(FaultCode.REQUEST_TOO_OLD, "too old")
                    self._arming.answer(request.request_id, too_old)
                case Arm() if request.stamp_ns > now_ns:
                    too_early = Fault(FaultCode.REQUEST_TOO_EARLY, "of the future")
                    self._arming.answer(request.request_id, too_early)
                case Arm() if stopping or request.stamp_ns <= self._stopped_ns:
                    self._arming.answer(request.request_id, _before_stop(self.machine.reason))
                case Arm():
                    self._arming.wait(request)
                    self._objections = inputs.objections
                    if self.machine.state in LATCHED:
                        self._on(Event.RESET, "arming after a stop", now_ns)
        return stop

    def _supervise(self, now_ns: int) -> bool:
        """Let supervision move the state machine; return whether others must stop the drive."""
        if self.machine.powered:
            fault = self._supervision.fault(now_ns)
            if fault is None:
                return False
            self._on(Event.FAULT, fault, now_ns)
        elif self.machine.state not in LATCHED:
            problem = self._health.node_problem(now_ns)
            if problem is None:
                self._on(Event.READY, "", now_ns)
            elif not self._on(Event.NOT_READY, problem, now_ns):
                self.machine.explain(problem)
        unasked = self._supervision.unasked()
        if unasked:
            self._on(Event.EMERGENCY_STOP, unasked, now_ns)
        return unasked is not None

    def _try_to_arm(self, now_ns: int) -> bool:
        """Arm if nothing speaks against it; return whether the drive's latches must be cleared."""
        arming = self._arming
        if self.machine.powered:
            arming.answer_waiting()
            return False
        refusals = self._refusals(now_ns)
        if not refusals and self._on(Event.ARM, "", now_ns):
            arming.answer_waiting()
            self._take_over(now_ns)
            return False
        if now_ns - arming.since_ns > self._safety.arm_timeout_ms * 1_000_000:
            refusals = refusals or (Fault(FaultCode.NOT_READY, self.machine.reason),)
            arming.answer_waiting(*refusals)
            text = f"arming refused: {'; '.join(map(str, refusals))}"
            self._notices.append(Notice(now_ns, Severity.WARNING, text))
            return False
        if self._health.drive_latched and now_ns - self._cleared_ns > _CLEAR_INTERVAL_NS:
            self._cleared_ns = now_ns
            return True
        return False

    def _refusals(self, now_ns: int) -> tuple[Fault, ...]:
        """Return all reasons against arming now."""
        refusals = self._objections + self._powerless
        refusals += self._supervision.refusals(
            now_ns, self._motion.speeds_rad_s, enabled=self._command_before.enable
        )
        if not self.warm:
            of = self._safety.warmup_ticks
            text = f"the control loop is not warm: tick {self._ticks} of {of}"
            refusals += (Fault(FaultCode.NOT_WARM, text),)
        return refusals

    def _take_over(self, now_ns: int) -> None:
        """Start the wheel loops from the present motion, so that arming causes no jump."""
        self._velocity = None
        self._armed_ns = now_ns
        self._node_events.forget_errors()
        self._supervision.armed(now_ns)
        self._limiter.reset(self._twist_meas.v_m_s, self._twist_meas.omega_rad_s)
        for wheel in self._wheels:
            wheel.reset()

    def _drive_wheels(self, now_ns: int) -> WheelCommand:
        """Return the command for the present state and velocity set-point."""
        if not self.machine.powered:
            return self._stopped()
        wanted_v, wanted_omega = self._setpoint(now_ns)
        self._twist_ref = reference = self._limiter.step(wanted_v, wanted_omega, self._period_s)
        if wanted_v != 0.0 or wanted_omega != 0.0:
            if self.machine.state is SafetyState.ARMED:
                self._on(Event.MOVE, "", now_ns)
        elif reference == (0.0, 0.0) and abs(self._twist_meas.v_m_s) < _AT_REST_M_S:
            self._on(Event.REST, "", now_ns)
        return self._wheel_command(reference, now_ns)

    def _setpoint(self, now_ns: int) -> tuple[float, float]:
        """Return the velocity wanted now; rest where the set-point is missing or void."""
        velocity = self._velocity
        if velocity is None or now_ns > velocity.expires_ns:
            return 0.0, 0.0
        if velocity.stamp_ns < self._armed_ns:  # who wanted it did not know of the arming
            return 0.0, 0.0
        age_ns = now_ns - velocity.stamp_ns
        if not 0 <= age_ns <= self._setpoint_limit_ns:
            return 0.0, 0.0
        return velocity.v_m_s, velocity.omega_rad_s

    def _wheel_command(self, reference: Twist, now_ns: int) -> WheelCommand:
        """Close the wheel loops on a body velocity."""
        wheels = self._drive.inverse(reference.v_m_s, reference.omega_rad_s, self._steering_rad)
        drive = self._health.drive
        bus_voltage_v = drive.bus_voltage_v if drive is not None else 0.0
        dt_s = self._period_s
        duty1 = self._wheels[0].step(wheels.omega1_rad_s, bus_voltage_v, dt_s)
        duty2 = 0.0
        if len(self._wheels) == 2:
            duty2 = self._wheels[1].step(wheels.omega2_rad_s, bus_voltage_v, dt_s)
        guarded = guard_command(
            True,
            duty1,
            duty2,
            wheels.steering_rad,
            self._steering_max_rad,
            self._command.steering_rad,
        )
        if guarded.fault:
            fault = Fault(FaultCode.COMMAND_GUARD, f"command guard: {guarded.fault}")
            self._on(Event.FAULT, fault, now_ns)
            return self._stopped()
        return WheelCommand(True, False, guarded.duty1, guarded.duty2, guarded.steering_rad)

    def _stopped(self) -> WheelCommand:
        """Return the command that brakes the wheels and leaves the steering where it is."""
        self._twist_ref = Twist(0.0, 0.0)
        return WheelCommand(False, True, 0.0, 0.0, self._steering_rad)

    def _on(self, event: Event, why: Fault | str, now_ns: int) -> bool:
        """Apply an event to the state machine and tell people of stops and starts."""
        changed = self.machine.on(event, why)
        self._armings += changed and event is Event.ARM
        if event is Event.EMERGENCY_STOP or (changed and event is Event.FAULT):
            self._stopped_ns = now_ns
            self._arming.answer_waiting(_before_stop(str(why)))
        if changed and event in (Event.EMERGENCY_STOP, Event.FAULT):
            self._velocity = None
            self._notices.append(Notice(now_ns, Severity.CRITICAL, f"stopped: {why}"))
        elif changed and event in (Event.ARM, Event.DISARM, Event.READY):
            text = {"arm accepted": "armed", "all nodes ready": "ready to arm"}
            line = text.get(event.value, "disarmed")
            self._notices.append(Notice(now_ns, Severity.INFORMATION, line))
        elif changed and event is Event.NOT_READY:
            self._notices.append(Notice(now_ns, Severity.WARNING, f"not ready: {why}"))
        return changed

    def snapshot(self, now_ns: int, loop: LoopStatistics) -> ControlState:
        """Return what other processes may know."""
        health, pose = self._health, self.odometry.pose_world_base
        motor, drive = health.fresh_motor(now_ns), health.fresh_drive(now_ns)
        wheels = self._wheels
        measured = health.wheels_fresh(now_ns)
        twist = self._twist_meas if measured else _UNKNOWN_TWIST
        duties = (self._command.duty1, self._command.duty2)
        n, fault = len(wheels), self.machine.fault
        return ControlState(
            stamp_ns=now_ns,
            state=self.machine.state,
            reason=self.machine.reason,
            x_m=pose.x_m,
            y_m=pose.y_m,
            theta_rad=pose.theta_rad,
            v_m_s=twist.v_m_s,
            omega_rad_s=twist.omega_rad_s,
            v_ref_m_s=self._twist_ref.v_m_s,
            omega_ref_rad_s=self._twist_ref.omega_rad_s,
            distance_m=self.odometry.distance_m,
            wheel_rad_s=self._motion.speeds_rad_s if measured else (math.nan,) * n,
            wheel_ref_rad_s=tuple(w.reference_rad_s for w in wheels),
            wheel_distance_m=tuple(
                w.estimator.position_rad * radius_m
                for w, radius_m in zip(wheels, self._drive.wheel_radii_m, strict=True)
            ),
            duty=duties[:n],
            current_a=(motor.current1_a, motor.current2_a)[:n] if motor else (),
            temperature_c=(motor.temperature1_c, motor.temperature2_c)[:n] if motor else (),
            steering_rad=self._steering_rad,
            bus_voltage_v=drive.bus_voltage_v if drive else math.nan,
            battery=health.fresh_battery(now_ns),
            sonar_m=health.fresh_sonar_m(now_ns),
            sonar_stamp_ns=tuple(max(stamp_ns, 0) for stamp_ns in health.sonar_ns),
            faults=motor.faults if motor else 0,
            nodes=health.nodes,
            bus=health.bus,
            loop=loop,
            odometer_m=self.odometer_start_m + self.odometry.distance_m,
            acks=self._arming.acks,
            armings=self._armings,
            fault=fault.code if fault else FaultCode.NONE,
            fault_part=fault.part if fault else "",
            odom_epoch_ns=self._odom_epoch_ns,
        )


def fastest_wheel_rad_s(drive: Drive, limits: LimitsConfig) -> float:
    """Return how fast a wheel turns at both speed limits at once [rad/s]."""
    corner = drive.inverse(limits.v_max_m_s, limits.omega_max_rad_s, 0.0)
    return max(abs(corner.omega1_rad_s), abs(corner.omega2_rad_s))


def impossible_wheel_rad_s(drive: Drive, limits: LimitsConfig) -> float:
    """Return a speed that no wheel of this robot has [rad/s]: counts that need it are wrong."""
    pushed_rad_s = _PUSHED_M_S / min(drive.wheel_radii_m)
    return _IMPOSSIBLE_SHARE * fastest_wheel_rad_s(drive, limits) + pushed_rad_s


def _before_stop(why: str) -> Fault:
    """Return the answer to a request to arm of before a stop."""
    return Fault(FaultCode.REQUEST_BEFORE_STOP, f"made before the stop: {why}")
