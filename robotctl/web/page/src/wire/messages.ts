// Written by tools/write_page_types.py from the messages of robotctl: do not edit.

/** How a struct that does not arrive as the object of its type becomes one. */
export interface Shape {
  /** Names of the fields of a struct that arrives as an array, in order. */
  readonly fields?: readonly string[];
  /** Structs in fields, by field; [] behind the name: an array of them. */
  readonly nested?: Readonly<Record<string, string>>;
}

export const FaultCode = {
  NONE: 0,
  BUS_OFF: 10,
  BUS_DOWN: 11,
  BUS_PASSIVE: 12,
  BUS_FULL: 13,
  BUS_STRANGER: 14,
  BUS_ERRORS: 15,
  BUS_BLOCKED: 16,
  BUS_SILENT: 17,
  WHEELS_STALE: 20,
  MOTOR_STALE: 21,
  DRIVE_STALE: 22,
  BATTERY_STALE: 23,
  BATTERY_MISSING: 24,
  SONAR_STALE: 25,
  IMU_STALE: 26,
  CONTROL_HELD_UP: 30,
  COMMAND_GUARD: 31,
  RIGHT_MISSING: 32,
  NOT_WARM: 33,
  NO_GAINS: 34,
  COMMAND_LOSS: 40,
  DRIVE_NOT_ENABLED: 41,
  DRIVE_STOPPED: 42,
  DRIVE_EMERGENCY_STOP: 43,
  DRIVE_FAULT: 44,
  DRIVE_OVER_CURRENT: 45,
  DRIVE_OVER_TEMPERATURE: 46,
  DRIVE_UNDER_VOLTAGE: 47,
  DRIVE_ENCODER: 48,
  DRIVE_COMMAND_TIMEOUT: 49,
  DRIVE_PARAMETER: 50,
  DRIVE_OVER_VOLTAGE: 51,
  DRIVE_UNREADABLE: 52,
  DRIVE_UNPROVEN: 53,
  BATTERY_CRITICAL: 60,
  BATTERY_LOW: 61,
  NODE_NOT_HEARD: 70,
  NODE_SILENT: 71,
  NODE_STARTING: 72,
  NODE_REFUSED: 73,
  NODE_CHANGED: 74,
  NODE_PUT_OUT: 75,
  NODE_RESTARTED: 76,
  NODE_NO_ANSWER: 77,
  NODE_OTHER_DEVICE: 78,
  NODE_OTHER_FIRMWARE: 79,
  EMERGENCY_STOP: 80,
  EMERGENCY_STOP_BUS: 81,
  DRIVES_UNASKED: 82,
  NODE_OTHER_VALUE: 90,
  NODE_DOUBLED: 91,
  NODE_MISREPORTED: 92,
  ENCODER_STUCK: 100,
  ENCODER_REVERSED: 101,
  ENCODERS_SWAPPED: 102,
  ENCODER_WRONG: 103,
  ENCODER_JUMPS: 104,
  WHEELS_CONTRADICT: 105,
  WHEEL_BLOCKED: 106,
  WHEEL_PUSHES: 107,
  STEERING_OFF: 108,
  CLOCK_DRIFT: 109,
  WHEEL_ASTRAY: 110,
  WHEELS_SLIP: 120,
  SONAR_STUCK: 121,
  ODOMETRY_REVERSED: 122,
  ROBOT_TILTED: 123,
  PICKED_UP: 124,
  IMU_STUCK: 125,
  GYRO_CONTRADICTS: 126,
  TEMPERATURE_WRONG: 130,
  CURRENT_WRONG: 131,
  SUPPLY_WRONG: 132,
  STEERING_WRONG: 133,
  REQUEST_TOO_OLD: 140,
  REQUEST_TOO_EARLY: 141,
  REQUEST_BEFORE_STOP: 142,
  REQUEST_WITHDRAWN: 143,
  NOT_READY: 144,
} as const;
export type FaultCode = (typeof FaultCode)[keyof typeof FaultCode];

export const BusState = {
  ERROR_ACTIVE: 0,
  ERROR_WARNING: 1,
  ERROR_PASSIVE: 2,
  BUS_OFF: 3,
  DOWN: 4,
} as const;
export type BusState = (typeof BusState)[keyof typeof BusState];

export const Outcome = {
  NONE: 0,
  RUNNING: 1,
  DONE: 2,
  REFUSED: 3,
  FAILED: 4,
  CANCELLED: 5,
} as const;
export type Outcome = (typeof Outcome)[keyof typeof Outcome];

export const SafetyState = {
  BOOT: 0,
  STANDBY: 1,
  ARMED: 2,
  DRIVING: 3,
  FAULT: 4,
  EMERGENCY_STOP: 5,
  MOTOR_TEST: 6,
} as const;
export type SafetyState = (typeof SafetyState)[keyof typeof SafetyState];

export const Mode = {
  MANUAL: 0,
  HOLD: 4,
  AUTO: 10,
  RTL: 11,
  GUIDED: 15,
} as const;
export type Mode = (typeof Mode)[keyof typeof Mode];

export const LocalisationStatus = {
  SEARCHING: 0,
  LOCALISED: 1,
  LOST: 2,
} as const;
export type LocalisationStatus = (typeof LocalisationStatus)[keyof typeof LocalisationStatus];

export interface BatteryFeedback {
  readonly stamp_ns: number;
  readonly voltage_v: number;
  readonly current_a: number;
  readonly charge: number;
  readonly temperature_c: number;
  readonly low: boolean;
  readonly critical: boolean;
}

export interface NodeStatus {
  readonly node_id: number;
  readonly name: string;
  readonly nmt_state: number;
  readonly heartbeat_ns: number;
  readonly boots: number;
  readonly problem: string;
  readonly fault: FaultCode;
}

export interface BusStatus {
  readonly state: BusState;
  readonly received: number;
  readonly sent: number;
  readonly send_failures: number;
  readonly error_frames: number;
  readonly crc_rejects: number;
  readonly counter_rejects: number;
  readonly lost: number;
  readonly load: number;
}

export interface LoopStatistics {
  readonly rate_hz: number;
  readonly ticks: number;
  readonly overruns: number;
  readonly lag_us_p50: number;
  readonly lag_us_p99: number;
  readonly lag_us_p999: number;
  readonly lag_us_max: number;
  readonly step_us_p50: number;
  readonly step_us_p99: number;
  readonly overrun_causes: Readonly<Record<string, number>>;
  readonly stage_us_p50: Readonly<Record<string, number>>;
  readonly stage_us_p99: Readonly<Record<string, number>>;
}

export interface Fault {
  readonly code: FaultCode;
  readonly text: string;
  readonly part: string;
}

export interface Ack {
  readonly request_id: number;
  readonly accepted: boolean;
  readonly reasons: readonly Fault[];
}

export interface ImuFeedback {
  readonly stamp_ns: number;
  readonly gyro_stamp_ns: number;
  readonly rate_rad_s: readonly [number, number, number];
  readonly force_m_s2: readonly [number, number, number];
  readonly up: readonly [number, number, number];
  readonly bias_rad_s: readonly [number, number, number];
  readonly rise_m_s: number;
  readonly slip_rad: number;
  readonly ahead_rad: number;
  readonly corrected_rad: number;
}

export interface Procedure {
  readonly request_id: number;
  readonly outcome: Outcome;
  readonly progress: number;
  readonly text: string;
}

export interface ControlState {
  readonly type: "ControlState";
  readonly stamp_ns: number;
  readonly state: SafetyState;
  readonly reason: string;
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
  readonly v_m_s: number;
  readonly omega_rad_s: number;
  readonly v_ref_m_s: number;
  readonly omega_ref_rad_s: number;
  readonly distance_m: number;
  readonly wheel_rad_s: readonly number[];
  readonly wheel_ref_rad_s: readonly number[];
  readonly wheel_distance_m: readonly number[];
  readonly duty: readonly number[];
  readonly current_a: readonly number[];
  readonly temperature_c: readonly number[];
  readonly steering_rad: number;
  readonly bus_voltage_v: number;
  readonly battery: BatteryFeedback | null;
  readonly sonar_m: readonly number[];
  readonly sonar_stamp_ns: readonly number[];
  readonly nodes: readonly NodeStatus[];
  readonly bus: BusStatus;
  readonly loop: LoopStatistics;
  readonly odometer_m: number;
  readonly acks: readonly Ack[];
  readonly armings: number;
  readonly fault: FaultCode;
  readonly fault_part: string;
  readonly odom_epoch_ns: number;
  readonly imu: ImuFeedback | null;
  readonly against_arming: readonly Fault[];
  readonly tuning: number;
  readonly procedure: Procedure;
  readonly vy_m_s: number;
  readonly vy_ref_m_s: number;
  readonly stopped_ns: number;
}

export interface FenceState {
  readonly crc: number;
  readonly enabled: boolean;
  readonly limits: boolean;
  readonly breached: boolean;
  readonly breaches: number;
  readonly breached_ns: number;
}

export interface StepBudget {
  readonly period_ms: number;
  readonly steps: number;
  readonly late: number;
  readonly p50_ms: number;
  readonly p99_ms: number;
  readonly parts_p50_ms: Readonly<Record<string, number>>;
  readonly parts_p99_ms: Readonly<Record<string, number>>;
  readonly effort: number;
}

export interface NavigationState {
  readonly type: "NavigationState";
  readonly stamp_ns: number;
  readonly mode: Mode;
  readonly mission: string;
  readonly item: number;
  readonly items: number;
  readonly item_name: string;
  readonly mission_completed: boolean;
  readonly mission_failed: boolean;
  readonly message: string;
  readonly step_us: number;
  readonly item_s_m: number;
  readonly plans: number;
  readonly recoveries: number;
  readonly goals: number;
  readonly goal_reached: boolean | null;
  readonly mission_file: string;
  readonly mission_crc: number;
  readonly mission_runs: number;
  readonly mission_commands: number;
  readonly loop_counts: readonly number[];
  readonly loops: string;
  readonly waits: boolean;
  readonly trouble: string;
  readonly held: boolean;
  readonly fence: FenceState;
  readonly rally_crc: number;
  readonly goal: readonly [number, number] | null;
  readonly tuning: number;
  readonly reverse: boolean;
  readonly home: readonly [number, number, number] | null;
  readonly budget: StepBudget;
  readonly wanted: readonly [number, number, number];
  readonly limited_by: string;
  readonly body: number;
  readonly areas: readonly string[];
}

export interface ClosedLoop {
  readonly stamp_ns: number;
  readonly earlier_ns: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
}

export interface LocalisationState {
  readonly type: "LocalisationState";
  readonly stamp_ns: number;
  readonly method: string;
  readonly status: LocalisationStatus;
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
  readonly covariance: readonly number[];
  readonly particles: number;
  readonly nis: number;
  readonly nis_dof: number;
  readonly step_us: number;
  readonly odom_epoch_ns: number;
  readonly epoch_ns: number;
  readonly loops: readonly ClosedLoop[];
  readonly verdict: string;
  readonly paused: boolean;
  readonly tracked: boolean;
}

export interface Notice {
  readonly type: "Notice";
  readonly stamp_ns: number;
  readonly severity: number;
  readonly text: string;
}

export interface LidarScan {
  readonly type: "LidarScan";
  readonly stamp_ns: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly first_rad: number;
  readonly step_rad: number;
  readonly max_range_m: number;
  readonly ranges: Uint8Array;
  readonly name: string;
  readonly sweep_s: number;
}

export interface SeenObstacle {
  readonly x_m: number;
  readonly y_m: number;
  readonly covariance: readonly number[];
  readonly width_m: number;
}

export interface SeenMarker {
  readonly number: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
}

export interface ImageFeatures {
  readonly points: Uint8Array;
  readonly descriptors: Uint8Array;
  readonly aspect: number;
}

export interface CameraView {
  readonly type: "CameraView";
  readonly stamp_ns: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly max_range_m: number;
  readonly angles_rad: readonly number[];
  readonly ranges_m: readonly number[];
  readonly sigmas_m: readonly number[];
  readonly nearest_m: readonly number[];
  readonly obstacles: readonly SeenObstacle[];
  readonly trouble: string;
  readonly step_us: number;
  readonly markers: readonly SeenMarker[];
  readonly features: ImageFeatures | null;
}

export interface ParticleCloud {
  readonly type: "ParticleCloud";
  readonly stamp_ns: number;
  readonly poses: Uint8Array;
}

export interface LiveMap {
  readonly type: "LiveMap";
  readonly stamp_ns: number;
  readonly rows: number;
  readonly columns: number;
  readonly resolution_m: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly cells: Uint8Array;
  readonly theta_rad: number;
}

export interface PlanView {
  readonly type: "PlanView";
  readonly stamp_ns: number;
  readonly path: Uint8Array;
  readonly arc: Uint8Array;
  readonly obstacles: Uint8Array;
  readonly moving: readonly (readonly [number, number, number, number, number])[];
  readonly costs: LiveMap;
}

export interface GivenMap {
  readonly type: "GivenMap";
  readonly stamp_ns: number;
  readonly map: LiveMap;
}

export interface SlamGraph {
  readonly type: "SlamGraph";
  readonly stamp_ns: number;
  readonly poses: Uint8Array;
  readonly links: Uint8Array;
  readonly loops: Uint8Array;
}

export interface MissionView {
  readonly type: "MissionView";
  readonly stamp_ns: number;
  readonly file: string;
  readonly crc: number;
  readonly content: Uint8Array;
}

export interface DrawnZone {
  readonly name: string;
  readonly corners: readonly (readonly [number, number])[];
  readonly speed_m_s: number;
  readonly origin: string;
}

export interface KnownPlace {
  readonly name: string;
  readonly x_m: number;
  readonly y_m: number;
}

export interface BoundsView {
  readonly type: "BoundsView";
  readonly stamp_ns: number;
  readonly fence: readonly [polygons: readonly (readonly [corners: readonly (readonly [number, number])[], keeps_in: boolean])[], circles: readonly (readonly [x_m: number, y_m: number, radius_m: number, keeps_in: boolean])[]];
  readonly fence_crc: number;
  readonly fence_enabled: boolean;
  readonly zones: readonly DrawnZone[];
  readonly zones_crc: number;
  readonly rally: readonly (readonly [number, number])[];
  readonly rally_crc: number;
  readonly home: readonly [number, number, number];
  readonly places: readonly KnownPlace[];
  readonly links: readonly (readonly [number, number])[];
}

export interface ParameterFacts {
  readonly name: string;
  readonly key: string;
  readonly default: boolean | number;
  readonly low: number;
  readonly high: number;
  readonly unit: string;
  readonly description: string;
  readonly change: string;
  readonly is_fixed: boolean;
  readonly is_whole: boolean;
}

export interface ParameterTable {
  readonly type: "ParameterTable";
  readonly stamp_ns: number;
  readonly parameters: readonly ParameterFacts[];
}

export interface ParameterValues {
  readonly type: "ParameterValues";
  readonly stamp_ns: number;
  readonly wanted: readonly (boolean | number)[];
  readonly in_force: readonly (boolean | number)[];
}

export interface RecorderState {
  readonly type: "RecorderState";
  readonly stamp_ns: number;
  readonly folder: string;
  readonly is_recording: boolean;
  readonly trouble: string;
  readonly free_bytes: number | null;
}

export interface Truth {
  readonly type: "Truth";
  readonly stamp_ns: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
  readonly v_m_s: number;
  readonly omega_rad_s: number;
  readonly distance_m: number;
  readonly collisions: number;
  readonly charge: number;
  readonly bus_frames: number;
  readonly bus_load: number;
  readonly bus_errors: number;
  readonly late: number;
  readonly late_max_ns: number;
  readonly power_off_ns: number;
  readonly unsafe_motions: number;
  readonly unsafe_reason: string;
  readonly ran_into: number;
  readonly people: readonly (readonly [number, number])[];
  readonly vy_m_s: number;
  readonly body: number;
}

export interface SonarOutline {
  readonly name: string;
  readonly x_m: number;
  readonly y_m: number;
  readonly heading_rad: number;
}

export interface RecordedRun {
  readonly name: string;
  readonly run: number | null;
  readonly begin_ns: number;
  readonly end_ns: number;
}

export interface Hello {
  readonly type: "Hello";
  readonly name: string;
  readonly version: string;
  readonly simulated: boolean;
  readonly drive: string;
  readonly holonomic: boolean;
  readonly has_lidar: boolean;
  readonly has_localiser: boolean;
  readonly bodies: readonly (readonly (readonly (readonly [number, number])[])[])[];
  readonly sonars: readonly SonarOutline[];
  readonly v_max_m_s: number;
  readonly omega_max_rad_s: number;
  readonly vy_max_m_s: number;
  readonly wheels: readonly string[];
  readonly file: string;
  readonly protocol: number;
  readonly client: number;
  readonly role: string;
  readonly server_ns: number;
  readonly robot_ns: number;
  readonly replay: RecordedRun | null;
}

export interface Pong {
  readonly type: "Pong";
  readonly t: number;
  readonly server_ns: number;
  readonly robot_ns: number;
}

export interface Driver {
  readonly type: "Driver";
  readonly client: number | null;
  readonly name: string;
  readonly why: string;
  readonly asking: number | null;
  readonly asking_name: string;
  readonly driving: boolean;
  readonly locked: string;
}

export interface Refused {
  readonly type: "Refused";
  readonly id: number;
  readonly reason: string;
}

export interface StopSeen {
  readonly type: "StopSeen";
  readonly id: number;
  readonly state: number | null;
  readonly reason: string;
  readonly after_ms: number;
}

export interface CameraPicture {
  readonly type: "CameraPicture";
  readonly stamp_ns: number;
  readonly width: number;
  readonly height: number;
  readonly jpeg: Uint8Array;
  readonly boundary: readonly (readonly [number, number] | null)[];
  readonly floor: readonly (readonly [number, number] | null)[];
  readonly things: readonly (readonly [number, number, number])[];
  readonly trouble: string;
}

export interface Saved {
  readonly type: "Saved";
  readonly id: number;
  readonly file: string;
  readonly copy: string;
  readonly keys: readonly string[];
}

export interface Response {
  readonly type: "Response";
  readonly id: number;
  readonly stamp_ns: readonly number[];
  readonly wheel_ref_rad_s: readonly (readonly number[])[];
  readonly wheel_rad_s: readonly (readonly number[])[];
}

export interface ComputerState {
  readonly type: "ComputerState";
  readonly processor: number | null;
  readonly temperature_c: number | null;
  readonly memory_free: number;
  readonly memory: number;
  readonly disk_free: number | null;
}

export interface Playback {
  readonly type: "Playback";
  readonly at_ns: number;
  readonly end_ns: number;
  readonly rate: number;
  readonly is_playing: boolean;
  readonly topics: readonly string[];
  readonly offsets_ns: readonly number[];
  readonly by_driving: boolean;
}

export interface Ping {
  readonly type: "Ping";
  readonly t: number;
}

export interface StopRequest {
  readonly type: "StopRequest";
  readonly id: number;
}

export interface GiveDriving {
  readonly type: "GiveDriving";
}

export interface Sticks {
  readonly type: "Sticks";
  readonly sample: number;
  readonly at_ms: number;
  readonly held: boolean;
  readonly forward: number;
  readonly turn: number;
  readonly sideways: number;
}

export interface WatchCamera {
  readonly type: "WatchCamera";
  readonly watch: boolean;
}

export interface ArmRequest {
  readonly type: "ArmRequest";
  readonly id: number;
  readonly at_ms: number;
  readonly arm: boolean;
}

export interface ModeRequest {
  readonly type: "ModeRequest";
  readonly id: number;
  readonly at_ms: number;
  readonly mode: Mode;
}

export interface GoTo {
  readonly type: "GoTo";
  readonly id: number;
  readonly at_ms: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly heading_rad: number | null;
}

export interface PlaceRobot {
  readonly type: "PlaceRobot";
  readonly id: number;
  readonly at_ms: number;
  readonly x_m: number;
  readonly y_m: number;
  readonly theta_rad: number;
}

export interface TakeDriving {
  readonly type: "TakeDriving";
  readonly id: number;
  readonly at_ms: number;
}

export interface RecordRequest {
  readonly type: "RecordRequest";
  readonly id: number;
  readonly at_ms: number;
  readonly on: boolean;
}

export interface GoOn {
  readonly type: "GoOn";
  readonly id: number;
  readonly at_ms: number;
}

export interface JumpTo {
  readonly type: "JumpTo";
  readonly id: number;
  readonly at_ms: number;
  readonly item: number;
}

export interface Abort {
  readonly type: "Abort";
  readonly id: number;
  readonly at_ms: number;
}

export interface TuneRequest {
  readonly type: "TuneRequest";
  readonly id: number;
  readonly at_ms: number;
  readonly name: string;
  readonly value: number | null;
}

export interface ResetRequest {
  readonly type: "ResetRequest";
  readonly id: number;
  readonly at_ms: number;
}

export interface SaveRequest {
  readonly type: "SaveRequest";
  readonly id: number;
  readonly at_ms: number;
}

export interface ResponseRequest {
  readonly type: "ResponseRequest";
  readonly id: number;
  readonly at_ms: number;
}

export interface Seek {
  readonly type: "Seek";
  readonly at_ns: number;
}

export interface Play {
  readonly type: "Play";
  readonly rate: number;
}

export interface Pause {
  readonly type: "Pause";
}

export interface Align {
  readonly type: "Align";
  readonly by_driving: boolean;
}

export interface Stop {
  readonly type: "Stop";
  readonly id: number;
}

export interface Stretch {
  readonly begin_ns: number;
  readonly state: number;
  readonly reason: string;
}

export interface History {
  readonly times_s: Uint8Array;
  readonly points: Uint8Array;
  readonly begins: Uint8Array;
  readonly stretches: readonly Stretch[];
  readonly notices: readonly Notice[];
  readonly driving_ns: number | null;
  readonly end_ns: number;
  readonly notes: readonly string[];
}

export interface Series {
  readonly field: string;
  readonly times_s: Uint8Array;
  readonly values: Uint8Array;
}

export interface RecordedFile {
  readonly name: string;
  readonly size: number;
  readonly modified_s: number;
  readonly begin_s: number | null;
  readonly end_s: number | null;
  readonly is_written: boolean;
}

export interface RecordingList {
  readonly files: readonly RecordedFile[];
}

export type Received =
  | ControlState
  | NavigationState
  | LocalisationState
  | Notice
  | LidarScan
  | CameraView
  | ParticleCloud
  | PlanView
  | LiveMap
  | GivenMap
  | SlamGraph
  | MissionView
  | BoundsView
  | ParameterTable
  | ParameterValues
  | RecorderState
  | Truth
  | Hello
  | Pong
  | Driver
  | Refused
  | StopSeen
  | CameraPicture
  | Saved
  | Response
  | ComputerState
  | Playback;

export type Sent =
  | Ping
  | StopRequest
  | GiveDriving
  | Sticks
  | WatchCamera
  | ArmRequest
  | ModeRequest
  | GoTo
  | PlaceRobot
  | TakeDriving
  | RecordRequest
  | GoOn
  | JumpTo
  | Abort
  | TuneRequest
  | ResetRequest
  | SaveRequest
  | ResponseRequest
  | Seek
  | Play
  | Pause
  | Align;

export const SHAPES: Readonly<Record<string, Shape>> = {
  BatteryFeedback: {
    fields: ["stamp_ns", "voltage_v", "current_a", "charge", "temperature_c", "low", "critical"],
  },
  NodeStatus: {
    fields: ["node_id", "name", "nmt_state", "heartbeat_ns", "boots", "problem", "fault"],
  },
  BusStatus: {
    fields: ["state", "received", "sent", "send_failures", "error_frames", "crc_rejects", "counter_rejects", "lost", "load"],
  },
  ImuFeedback: {
    fields: ["stamp_ns", "gyro_stamp_ns", "rate_rad_s", "force_m_s2", "up", "bias_rad_s", "rise_m_s", "slip_rad", "ahead_rad", "corrected_rad"],
  },
  ControlState: {
    nested: { battery: "BatteryFeedback", nodes: "NodeStatus[]", bus: "BusStatus", imu: "ImuFeedback" },
  },
  ParameterFacts: {
    fields: ["name", "key", "default", "low", "high", "unit", "description", "change", "is_fixed", "is_whole"],
  },
  ParameterTable: {
    nested: { parameters: "ParameterFacts[]" },
  },
};
