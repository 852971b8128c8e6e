"""Messages between drivers, control core and processes.

All are frozen values. `stamp_ns` is always the sender's or receiver's monotonic clock in
nanoseconds; on one robot computer all processes share that clock (CLOCK_MONOTONIC).
"""

from __future__ import annotations

import enum
import math
from typing import TypeAlias

import msgspec

from robotctl.messages.actuators import ActuatorFeedback
from robotctl.messages.faults import Fault, FaultCode
from robotctl.messages.fence import FenceRequest, FenceState, SetRally
from robotctl.messages.mission import MissionCommand
from robotctl.messages.mode import Mode as Mode  # noqa: PLC0414 - part of the messages
from robotctl.messages.plans import SetZones
from robotctl.messages.procedures import (
    CalibrateGyro,
    CancelProcedure,
    MotorTest,
    Procedure,
)
from robotctl.messages.tuning import Tuning
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist


class EmergencyStopSource(enum.IntEnum):
    """Source of the emergency stop (EmergencyStop.EmergencyStopSource of robot.dbc)."""

    UNKNOWN = 0
    OPERATOR = 1
    GROUND_STATION = 2
    HOST_FAULT = 3
    WATCHDOG = 4
    TEST = 5
    NODE = 6


class Severity(enum.IntEnum):
    """Severity of a notice: numbers of RFC 5424, table 2, the same as MAV_SEVERITY."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFORMATION = 6


class BusState(enum.IntEnum):
    """State of the host's CAN controller (ISO 11898-1 fault confinement, and link down)."""

    ERROR_ACTIVE = 0
    ERROR_WARNING = 1
    ERROR_PASSIVE = 2
    BUS_OFF = 3
    DOWN = 4


class SafetyState(enum.IntEnum):
    """State of the robot: the rows of the table in `state_machine.py`."""

    BOOT = 0
    STANDBY = 1
    ARMED = 2
    DRIVING = 3
    FAULT = 4
    EMERGENCY_STOP = 5
    MOTOR_TEST = 6


class SonarFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Ranges (m) of sonars `first` to `first + 3`; inf: no echo; nan: no sensor or its fault."""

    stamp_ns: int
    first: int
    ranges_m: tuple[float, float, float, float]


class BatteryFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Battery voltage (V), current (A, positive discharges), charge [0, 1], temperature (degC)."""

    stamp_ns: int
    voltage_v: float
    current_a: float
    charge: float
    temperature_c: float
    low: bool
    critical: bool


class GyroFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Mean rates of turn about x, y, z of the IMU since the last frame (rad/s)."""

    stamp_ns: int
    x_rad_s: float
    y_rad_s: float
    z_rad_s: float


class AccelerometerFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """Mean specific force along x, y, z of the IMU since the last frame (m/s^2).

    At rest it is 9.81 upwards.
    """

    stamp_ns: int
    x_m_s2: float
    y_m_s2: float
    z_m_s2: float


class ImuFeedback(msgspec.Struct, frozen=True, gc=False, array_like=True):
    """IMU data in `base`, and derived quantities.

    `stamp_ns` is the time of the force, `gyro_stamp_ns` that of the rates. `rate_rad_s` are the
    mean rates about x, y, z as read, bias included (rad/s), `force_m_s2` the mean specific force
    along these axes (m/s^2). `up` is the unit vector away from the earth. `bias_rad_s` are the
    rates read at rest. `rise_m_s` is the upward speed within the last second (m/s). `slip_rad` is
    the robot's turn in excess of its wheels' within the last seconds (rad), `ahead_rad` the same
    since the start of the process, and `corrected_rad` the part of that applied to odometry (rad).
    """

    stamp_ns: int
    gyro_stamp_ns: int
    rate_rad_s: tuple[float, float, float]
    force_m_s2: tuple[float, float, float]
    up: tuple[float, float, float]
    bias_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rise_m_s: float = 0.0
    slip_rad: float = 0.0
    ahead_rad: float = 0.0
    corrected_rad: float = 0.0

    @property
    def tilt_rad(self) -> float:
        """Angle between the robot's z and up [rad]."""
        return math.acos(max(-1.0, min(self.up[2], 1.0)))

    @property
    def roll_rad(self) -> float:
        """Roll about x, left side up [rad]."""
        return math.atan2(self.up[1], self.up[2])

    @property
    def pitch_rad(self) -> float:
        """Pitch about y, nose down [rad]."""
        return math.atan2(-self.up[0], math.hypot(self.up[1], self.up[2]))


class EmergencyMessage(msgspec.Struct, frozen=True, array_like=True):
    """A CiA 301 EMCY of a node; code 0 means that its errors are reset."""

    stamp_ns: int
    node_id: int
    code: int
    register: int


class NodeStatus(msgspec.Struct, frozen=True, array_like=True):
    """Status of one CANopen node.

    `boots` counts its boots, the first included; `problem` is empty once the node is identified,
    has confirmed its parameters and is operational, else one sentence for the operator; `fault` is
    its kind.
    """

    node_id: int
    name: str
    nmt_state: int
    heartbeat_ns: int
    boots: int
    problem: str
    fault: FaultCode = FaultCode.NONE


class StrangerKind(enum.IntEnum):
    """Kinds of unexpected traffic of another sender on the bus."""

    HOST_FRAME = 0
    """A frame that only this computer may send."""
    SECOND_SENDER = 1
    """Process data of a node that a second device sends, too."""
    FALSE_STATE = 2
    """A false report that a node booted or left operational."""
    SDO_WRITE = 3
    """A write to a node's object dictionary."""


class Stranger(msgspec.Struct, frozen=True, array_like=True):
    """Frames of another sender on the bus since the start.

    `name` is the frame's name in the DBC, `node` that of the node concerned, empty for none.
    `count` is the number of frames since `first_ns`, `stamp_ns` the time of the last [ns], and
    `refused` the number of writes that the node refused.
    """

    kind: StrangerKind
    name: str
    arbitration_id: int
    node: str
    count: int
    first_ns: int
    stamp_ns: int
    refused: int = 0


class BusStatus(msgspec.Struct, frozen=True, array_like=True):
    """Counters of the host's side of the bus since the start; `load` is a share [0, 1]."""

    state: BusState = BusState.ERROR_ACTIVE
    received: int = 0
    sent: int = 0
    send_failures: int = 0
    error_frames: int = 0
    crc_rejects: int = 0
    counter_rejects: int = 0
    lost: int = 0
    load: float = 0.0


class Feedback(msgspec.Struct, frozen=True, array_like=True):
    """Feedback since the last tick; None and () without valid data.

    `actuators`, `nodes`, `bus` and `strangers` are the present state, not events.
    """

    actuators: tuple[ActuatorFeedback, ...] = ()
    sonars: tuple[SonarFeedback, ...] = ()
    battery: BatteryFeedback | None = None
    emergencies: tuple[EmergencyMessage, ...] = ()
    emergency_stop: EmergencyStopSource | None = None
    nodes: tuple[NodeStatus, ...] = ()
    bus: BusStatus = BusStatus()
    gyro: GyroFeedback | None = None
    accelerometer: AccelerometerFeedback | None = None
    strangers: tuple[Stranger, ...] = ()


class VelocityCommand(msgspec.Struct, frozen=True, tag=True):
    """Commanded body velocity of `base`; void after `expires_ns`.

    m/s forward, rad/s to the left, m/s sideways to the left.
    """

    stamp_ns: int
    expires_ns: int
    v_m_s: float
    omega_rad_s: float
    vy_m_s: float = 0.0

    @property
    def twist(self) -> Twist:
        """The velocity."""
        return Twist(self.v_m_s, self.omega_rad_s, self.vy_m_s)


class Arm(msgspec.Struct, frozen=True, tag=True):
    """Request to arm or disarm. `request_id` comes back in `ControlState.acks`."""

    stamp_ns: int
    request_id: int
    arm: bool


class EmergencyStop(msgspec.Struct, frozen=True, tag=True):
    """Request to stop at once and latch."""

    stamp_ns: int
    source: EmergencyStopSource


class SetMode(msgspec.Struct, frozen=True, tag=True):
    """Request to change the mode."""

    stamp_ns: int
    mode: Mode


class VelocityTarget(msgspec.Struct, frozen=True, tag=True):
    """GUIDED: a body velocity from the ground station; void after `expires_ns`.

    With `heading_rad`, a direction of `world` (rad), the robot turns to that and drives along it,
    and `omega_rad_s` is ignored. `vy_m_s` is to the left, for holonomic drives, and with
    `in_world` `v_m_s` and `vy_m_s` are along x and y of `world`, whatever the heading.
    """

    stamp_ns: int
    expires_ns: int
    v_m_s: float
    omega_rad_s: float
    heading_rad: float | None = None
    vy_m_s: float = 0.0
    in_world: bool = False


class PositionTarget(msgspec.Struct, frozen=True, tag=True):
    """GUIDED: a point of `world` (m) to drive to, kept until reached or replaced.

    `heading_rad` is the final heading; None: any.
    """

    stamp_ns: int
    x_m: float
    y_m: float
    heading_rad: float | None = None


class ManualControl(msgspec.Struct, frozen=True, tag=True):
    """MANUAL: sticks in [-1, 1], forward, turn and sideways to the left.

    Void after `expires_ns`; only holonomic drives move sideways.
    """

    stamp_ns: int
    expires_ns: int
    forward: float
    turn: float
    sideways: float = 0.0


class SetReverse(msgspec.Struct, frozen=True, tag=True):
    """AUTO, GUIDED: drive to places in reverse, or ahead again, until the mode changes."""

    stamp_ns: int
    reverse: bool


class SetHome(msgspec.Struct, frozen=True, tag=True):
    """Goal of RTL in `world` from now on (m, rad)."""

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float


class ExternalPose(msgspec.Struct, frozen=True, tag=True):
    """An externally measured pose of `base` in `world` at `stamp_ns`.

    `covariance` is the upper triangle of the covariance of (x, y, theta), row by row [m, m, rad];
    empty if the sender gave none.
    """

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float
    covariance: tuple[float, ...] = ()


class GroundStationPresence(msgspec.Struct, frozen=True, tag=True):
    """A ground station was present at `stamp_ns`, for robots that go to HOLD without one.

    `heard_ns` is the last heartbeat of the station whose loss stops an autonomous robot (ns); 0:
    there is none.
    """

    stamp_ns: int
    heard_ns: int = 0


ControlRequest: TypeAlias = (
    VelocityCommand | Arm | EmergencyStop | Tuning | CalibrateGyro | MotorTest | CancelProcedure
)
"""Requests to the control process."""

NavigationRequest: TypeAlias = (
    SetMode
    | VelocityTarget
    | PositionTarget
    | ManualControl
    | SetReverse
    | SetHome
    | ExternalPose
    | GroundStationPresence
    | MissionCommand
    | FenceRequest
    | SetRally
    | SetZones
    | Tuning
)
"""Requests to the navigation process."""


class Ack(msgspec.Struct, frozen=True):
    """Answer to an `Arm`: `reasons` says why it was refused, empty when accepted."""

    request_id: int
    accepted: bool
    reasons: tuple[Fault, ...] = ()


class LoopStatistics(msgspec.Struct, frozen=True):
    """Statistics of the control loop since its start.

    Lag is the wake-up after the deadline, step the time from receive to send.
    """

    rate_hz: float = 0.0
    ticks: int = 0
    overruns: int = 0
    lag_us_p50: float = 0.0
    lag_us_p99: float = 0.0
    lag_us_p999: float = 0.0
    lag_us_max: float = 0.0
    step_us_p50: float = 0.0
    step_us_p99: float = 0.0
    overrun_causes: dict[str, int] = {}
    stage_us_p50: dict[str, float] = {}
    stage_us_p99: dict[str, float] = {}


class ControlState(msgspec.Struct, frozen=True, tag=True):
    """State of the control process, published 50 times a second.

    `x_m`, `y_m`, `theta_rad` are `T_odom_base`, the pose of `base` in `odom` (m, rad); `WorldPose`
    transforms it to `world`. `odom_epoch_ns` is the start of that frame (ns): it changes with each
    new control process, and after a restart of the drive, whose motion meanwhile is unknown.
    Wheel arrays have one entry per driven wheel. Measured velocities are nan while wheel
    feedback is stale. `sonar_m[i]` belongs to the i-th sonar of the configuration: inf if there
    was no echo, nan if the sensor is missing, faulty or stale. `distance_m` counts from the
    start of the process, `odometer_m` over the robot's life (nan if its file cannot be read).
    `acks` are the last answers to `Arm`, the newest last. `armings` counts the armings since the
    start of the process; only it shows a stop and an arming between two states.
    `imu` is None on a robot without one, and while it is too old.
    `fault` is the kind of `reason`, NONE if that is not a fault; `fault_part` names the node, wheel
    or sonar concerned. `against_arming` are all present reasons against arming, empty while the
    robot is powered. `tuning` is the number of the `Tuning` in force. `procedure` is the last one
    requested. `stopped_ns` is the time of the last stop by a fault or emergency stop, 0: none since
    the start of the process.
    """

    stamp_ns: int
    state: SafetyState
    reason: str
    x_m: float
    y_m: float
    theta_rad: float
    v_m_s: float
    omega_rad_s: float
    v_ref_m_s: float
    omega_ref_rad_s: float
    distance_m: float
    wheel_rad_s: tuple[float, ...]
    wheel_ref_rad_s: tuple[float, ...]
    wheel_distance_m: tuple[float, ...]
    duty: tuple[float, ...]
    current_a: tuple[float, ...]
    temperature_c: tuple[float, ...]
    steering_rad: float
    bus_voltage_v: float
    battery: BatteryFeedback | None
    sonar_m: tuple[float, ...]
    sonar_stamp_ns: tuple[int, ...]
    nodes: tuple[NodeStatus, ...]
    bus: BusStatus
    loop: LoopStatistics
    odometer_m: float = 0.0
    acks: tuple[Ack, ...] = ()
    armings: int = 0
    fault: FaultCode = FaultCode.NONE
    fault_part: str = ""
    odom_epoch_ns: int = 0
    imu: ImuFeedback | None = None
    against_arming: tuple[Fault, ...] = ()
    tuning: int = 0
    procedure: Procedure = Procedure()
    vy_m_s: float = 0.0
    vy_ref_m_s: float = 0.0
    stopped_ns: int = 0

    @property
    def T_odom_base(self) -> SE2:
        """The pose of `base` in `odom`."""
        return SE2(self.x_m, self.y_m, self.theta_rad)

    @property
    def twist(self) -> Twist:
        """The measured velocity."""
        return Twist(self.v_m_s, self.omega_rad_s, self.vy_m_s)

    @property
    def twist_ref(self) -> Twist:
        """The present reference velocity of the wheels, within all limits."""
        return Twist(self.v_ref_m_s, self.omega_ref_rad_s, self.vy_ref_m_s)


class StepBudget(msgspec.Struct, frozen=True):
    """Times of the last 200 steps of navigation, in all and by part [ms]; empty: not measured.

    Parts: receive, localise, see, plan, steer, decide (the rest) and publish.

    `steps` and `late`, those that took longer than the period, count since the start. `effort` is
    the share of its samples by which it steers now, in (0, 1]: fewer where steps take too long.
    """

    period_ms: float = 0.0
    steps: int = 0
    late: int = 0
    p50_ms: float = 0.0
    p99_ms: float = 0.0
    parts_p50_ms: dict[str, float] = {}
    parts_p99_ms: dict[str, float] = {}
    effort: float = 1.0


class NavigationState(msgspec.Struct, frozen=True, tag=True):
    """State of the navigation process, published after each step.

    `item` counts mission items from 0 and equals `items` when the mission is completed; `item_s_m`
    is the distance along an item that is a path or a wall (m). `plans` and `recoveries` count plans
    and recoveries since the start. `goals` counts the accepted positions and explorations of
    GUIDED, and `goal_reached` is the result of the last one, None while it is under way or was
    replaced.

    `mission_file` is the file of a mission that was loaded since the start, `mission_crc` the
    CRC-32 of its content; empty and 0 for the mission of the start. `mission_runs` counts loads,
    restarts and aborts of missions, `mission_commands` the executed requests about the mission.
    `loop_counts` are the repeats and jumps taken, `loops` the same for people. `waits`: for an
    operator's go-ahead. `trouble` is the last failure of an item in this run of the mission.
    `held`: the robot itself went to HOLD, with the reason in `message`. `fence` is its state at the
    fence. `rally_crc` identifies its rally points, 0: there are none. `goal` is its present goal in
    `world` (m). `tuning` is the number of the `Tuning` in force. `reverse`: it drives to places in
    reverse. `home` is x, y (m) and heading (rad) of the goal of RTL in `world`, None: unchanged
    since the start. `budget` is renewed once a second. `wanted` is the velocity that its mode
    wants: forward (m/s), turning (rad/s) and to the left (m/s). `limited_by` is the obstacle for
    which the guard has slowed that, empty: it has not. `body` is the state of its body, by its
    place among the states in the robot's file; 0: there are none. `areas` are the binary masks that
    it is in, by the names of their files.
    """

    stamp_ns: int
    mode: Mode
    mission: str
    item: int
    items: int
    item_name: str
    mission_completed: bool
    mission_failed: bool
    message: str
    step_us: float = 0.0
    item_s_m: float = 0.0
    plans: int = 0
    recoveries: int = 0
    goals: int = 0
    goal_reached: bool | None = None
    mission_file: str = ""
    mission_crc: int = 0
    mission_runs: int = 0
    mission_commands: int = 0
    loop_counts: tuple[int, ...] = ()
    loops: str = ""
    waits: bool = False
    trouble: str = ""
    held: bool = False
    fence: FenceState = FenceState()
    rally_crc: int = 0
    goal: tuple[float, float] | None = None
    tuning: int = 0
    reverse: bool = False
    home: tuple[float, float, float] | None = None
    budget: StepBudget = StepBudget()
    wanted: tuple[float, float, float] = (0.0, 0.0, 0.0)
    limited_by: str = ""
    body: int = 0
    areas: tuple[str, ...] = ()


class Notice(msgspec.Struct, frozen=True, tag=True):
    """Lines of text for people; severities are those of RFC 5424 (0 worst), named or not."""

    stamp_ns: int
    severity: int
    text: str
