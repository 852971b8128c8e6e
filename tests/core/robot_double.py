"""A robot for tests of the core: ideal first-order wheels behind quantised encoders."""

import math
from dataclasses import replace

import msgspec

from robotctl.control.limiter import LimitsConfig
from robotctl.control.pid import PidConfig
from robotctl.core.config import ControlConfig
from robotctl.core.control_core import ControlCore, Inputs, Outputs
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.nodes.motor import DriveStatus, MotorStatus, WheelFeedback
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import (
    Arm,
    BatteryFeedback,
    BusStatus,
    ControlRequest,
    EmergencyMessage,
    Feedback,
    LoopStatistics,
    NodeStatus,
    SafetyState,
    SonarFeedback,
    VelocityCommand,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.sonar import SonarMount
from robotctl.safety.plausibility_config import PlausibilityConfig
from robotctl.safety.state_machine import SafetyConfig
from tests.native_frames import WHEELS, age_limits, native_feedback

PERIOD_NS = 5_000_000
SAFETY = SafetyConfig()
WARM_TICKS = SAFETY.warmup_ticks
BUS_V = 12.0
K_V_S_RAD = 0.45
RESISTANCE_OHM = 1.5
TAU_S = 0.08
DRIVE = DifferentialDrive("differential", 0.3, 0.05, 2400)
NODES = NodeParameters(200, 90, 350, sonars=4)
NO_IMU = ImuConfig()
PID = PidConfig(kp=0.25, ki=3.0, kv=K_V_S_RAD)


def make_core(
    safety: SafetyConfig = SAFETY, left: PidConfig = PID, imu: ImuConfig = NO_IMU
) -> ControlCore:
    return ControlCore(
        DRIVE,
        WHEELS,
        ControlConfig(left=left, right=PID),
        LimitsConfig(),
        safety,
        PlausibilityConfig(RESISTANCE_OHM, K_V_S_RAD),
        age_limits(replace(NODES, imu=imu.enabled), safety, PERIOD_NS),
        PERIOD_NS,
        tuple(SonarMount(name, 0.0, 0.1, 90.0) for name in ("a", "b", "c", "d")),
        imu,
        SE2(1.0, 2.0, 0.0),
    )


class RobotDouble:
    """Steps core and wheels together; every input can be withheld or bent by the test."""

    def __init__(self, safety: SafetyConfig = SAFETY) -> None:
        self.core = make_core(safety)
        self.frames = native_feedback()
        self.now_ns = 1_000_000_000
        self.speeds = [0.0, 0.0]
        self.angles = [0.0, 0.0]
        self.motor_state = DriveState.READY
        self.drive_says: DriveState | None = None
        self.node = 1, "drive"
        self.faults = 0
        self.problem = ""
        self.boots = 1
        self.bus = BusStatus()
        self.battery: BatteryFeedback | None = BatteryFeedback(0, 12.0, 1.0, 0.8, 25, False, False)
        self.held = False
        """Whether something holds the wheels."""
        self.mute_wheels = False
        self.mute_status = False
        self.command_age_ms = 1
        self.mute_battery = False
        self.battery_sent: BatteryFeedback | None = None
        self.battery_ns = 0
        self.mute_sonars = False
        self.sonar_ns = 0
        self.frozen_latch = False
        self.latch_ns = 0
        self.held_back: WheelFeedback | None = None
        self.heartbeat_ns: int | None = None
        self.sonar_m = (2.0, math.inf, 2.0, 2.0)
        self.objections: tuple[Fault, ...] = ()
        self.bus_stop = None
        self.emergencies: tuple[EmergencyMessage, ...] = ()
        self.record: list[tuple[int, Inputs, Outputs]] = []
        self.outputs = Outputs(ActuatorCommand())

    @property
    def state(self) -> SafetyState:
        return self.core.machine.state

    def tick(self, *requests: ControlRequest) -> Outputs:
        """One period: wheels move under the last command, then the core sees them."""
        self.now_ns += PERIOD_NS
        self._move()
        inputs = Inputs(self._feedback(), requests, self.objections)
        self.outputs = self.core.step(inputs, self.now_ns)
        self.record.append((self.now_ns, inputs, self.outputs))
        if self.outputs.clear_faults and self.motor_state not in (DriveState.BOOT,):
            self.motor_state = DriveState.READY
        if self.motor_state in (DriveState.READY, DriveState.ENABLED):
            enabled = self.outputs.command.enable
            self.motor_state = DriveState.ENABLED if enabled else DriveState.READY
        return self.outputs

    def ticks(self, count: int, velocity: tuple[float, float] | None = None) -> None:
        for _ in range(count):
            self.tick(*([self.velocity(*velocity)] if velocity else []))

    def velocity(self, v_m_s: float, omega_rad_s: float, ttl_ns: int = 200_000_000):
        return VelocityCommand(self.now_ns, self.now_ns + ttl_ns, v_m_s, omega_rad_s)

    def arm(self, request_id: int = 1) -> Outputs:
        return self.tick(Arm(self.now_ns, request_id, arm=True))

    def disarm(self) -> Outputs:
        return self.tick(Arm(self.now_ns, 99, arm=False))

    def armed(self) -> "RobotDouble":
        self.ticks(WARM_TICKS)
        self.arm()
        assert self.state == SafetyState.ARMED
        return self

    def snapshot(self):
        return self.core.snapshot(self.now_ns, LoopStatistics())

    def _move(self) -> None:
        command = self.outputs.command
        dt_s = PERIOD_NS * 1e-9
        for i, duty in enumerate(command.values or (0.0, 0.0)):
            on = command.enable and self.motor_state == DriveState.ENABLED
            final = duty * BUS_V / K_V_S_RAD if on else 0.0
            self.speeds[i] = final + (self.speeds[i] - final) * math.exp(-dt_s / TAU_S)
            self.speeds[i] = 0.0 if self.held else self.speeds[i]
            self.angles[i] += self.speeds[i] * dt_s

    def _feedback(self) -> Feedback:
        now = self.now_ns
        counts = [math.floor(angle / (2 * math.pi) * 2400) & 0xFFFF for angle in self.angles]
        status = not self.mute_status
        stop, self.bus_stop = self.bus_stop, None
        self.latch_ns = latch_ns = self.latch_ns if self.frozen_latch else now
        heartbeat_ns = now if self.heartbeat_ns is None else self.heartbeat_ns
        wheels = WheelFeedback(now, (latch_ns // 1000) & 0xFFFFF, (counts[0], counts[1]))
        if self.held_back is not None:
            wheels, self.held_back = msgspec.structs.replace(self.held_back, stamp_ns=now), None
        state = self.drive_says or self.motor_state
        self.frames.update(
            None if self.mute_wheels else wheels,
            MotorStatus(now, state, self.faults, self.currents_a(), (30, 30)) if status else None,
            DriveStatus(now, 0.0, BUS_V, self.command_age_ms) if status else None,
        )
        return Feedback(
            actuators=self.frames.reports,
            sonars=self._sonars(),
            battery=self._battery(),
            emergencies=self.emergencies,
            emergency_stop=stop,
            nodes=(
                NodeStatus(
                    *self.node,
                    5,
                    heartbeat_ns,
                    self.boots,
                    self.problem,
                    FaultCode.NODE_REFUSED if self.problem else FaultCode.NONE,
                ),
            ),
            bus=self.bus,
        )

    def _sonars(self) -> tuple[SonarFeedback, ...]:
        """One frame every 50 ms."""
        if self.mute_sonars or self.now_ns < self.sonar_ns + 50_000_000:
            return ()
        self.sonar_ns = self.now_ns
        return (SonarFeedback(self.now_ns, 0, self.sonar_m),)

    def _battery(self) -> BatteryFeedback | None:
        """One frame every 100 ms, and at once where the test puts in another battery."""
        battery = self.battery
        due = battery is not self.battery_sent or self.now_ns >= self.battery_ns + 100_000_000
        if battery is None or self.mute_battery or not due:
            return None
        self.battery_sent, self.battery_ns = battery, self.now_ns
        return msgspec.structs.replace(battery, stamp_ns=self.now_ns)

    def currents_a(self) -> tuple[float, ...]:
        """What the windings take: the voltage left after back-EMF, over the resistance."""
        command = self.outputs.command
        on = command.enable and self.motor_state == DriveState.ENABLED
        return tuple(
            (duty * BUS_V - K_V_S_RAD * speed) / RESISTANCE_OHM if on else 0.0
            for duty, speed in zip(command.values or (0.0, 0.0), self.speeds, strict=True)
        )
