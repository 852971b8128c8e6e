"""The configuration of one robot: a TOML file, checked as a whole."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias, Union

import msgspec

from robotctl import toml_source
from robotctl.control.limiter import LimitsConfig
from robotctl.control.wheel_velocity import STEP_MAX, WINDOW_S
from robotctl.core.config import ControlConfig, fastest_wheel_rad_s, impossible_wheel_rad_s
from robotctl.drivers.can.config import MAX_SUPPLY_V, CanConfig, PowerConfig
from robotctl.drivers.can.drives.fitting import problems as fitting_problems
from robotctl.drivers.can.drives.motor_drive import MotorConfig
from robotctl.drivers.can.drives.native.config import NAME as NATIVE_NAME
from robotctl.drivers.can.drives.native.config import native_motor
from robotctl.drivers.can.drives.registry import DRIVES
from robotctl.drivers.can.nodes.registry import CAN_NODES
from robotctl.errors import ConfigError, InvalidValue
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.localisers import localiser_kind
from robotctl.mavlink.config import MavlinkConfig
from robotctl.model.actuators import Takes
from robotctl.model.body import OUTSIDE_M, BodyConfig
from robotctl.model.drives.drives import Drive
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.footprint import Footprint
from robotctl.model.sensors.camera import CameraConfig
from robotctl.model.sensors.imu import ImuConfig
from robotctl.model.sensors.lidar import SOCKET, LidarConfig
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.config import GuardConfig, NavigationConfig
from robotctl.runtime.realtime import LoopConfig
from robotctl.runtime.storage.log_folder import LogConfig
from robotctl.safety.plausibility_config import OF_DUTY_WHEELS, PlausibilityConfig
from robotctl.safety.state_machine import SafetyConfig
from robotctl.toml_source import BY_KIND, TABLE_OR_TABLES
from robotctl.web.config import WebConfig

MAX_SONARS = 16

RING_S: Final = 0.05
"""Period of one sonar's readings [s]; the second one stops the robot."""

FINEST_RAD: Final = 1e-9
"""Finest resolution of a wheel encoder [rad]."""

FOUND_SHARE: Final = 0.5
"""Share of a motor's minimum top speed at which a stuck encoder is detected."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of the robot.

    Parameters
    ----------
    name
        Name in logs, sockets and on the ground station.
    """

    name: str

    def __post_init__(self) -> None:
        """Check the name, which becomes part of file names."""
        if not self.name.replace("_", "").replace("-", "").isalnum():
            raise InvalidValue(
                "name", f"must be letters, digits, - and _, not {self.name!r}", self.name
            )


Buses = Annotated[CanConfig | tuple[CanConfig, ...], TABLE_OR_TABLES]
"""One bus, `[can]`, or several, `[[can]]` each."""

Lidars = Annotated[LidarConfig | tuple[LidarConfig, ...], TABLE_OR_TABLES]
"""One lidar, `[lidar]`, or several, `[[lidar]]` each."""


if TYPE_CHECKING:
    Motor: TypeAlias = MotorConfig
else:
    Motor = Annotated[Union[DRIVES], BY_KIND]  # noqa: UP007 - of any length
    """A table `[[motor]]` of any kind."""


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """Everything about one robot.

    Parameters
    ----------
    motor
        Motor drives. Without one, our own controller turns all wheels.
    nodes
        Bus of each node, by their names; a node without one is on the first.
    proof
        Settings with which each drive was seen to stop when the host is silent, by the names of the
        drives; `robotctl setup` writes it. See docs/hardware.md.
    simulation
        What is true of the robot in the simulated world, whatever the rest of the file believes;
        docs/missions.md lists the keys. firmware_sim checks them itself.
    """

    robot: Identity
    drive: Annotated[Drive, BY_KIND]
    limits: LimitsConfig
    control: ControlConfig = field(default_factory=ControlConfig)
    plausibility: PlausibilityConfig = field(default_factory=PlausibilityConfig)
    body: BodyConfig = field(default_factory=BodyConfig)
    sonar: tuple[SonarMount, ...] = ()
    lidar: Lidars | None = None
    imu: ImuConfig = field(default_factory=ImuConfig)
    camera: CameraConfig | None = None
    ground_camera: GroundCameraConfig = field(default_factory=GroundCameraConfig)
    can: Buses = field(default_factory=CanConfig)
    motor: tuple[Motor, ...] = ()
    nodes: dict[str, str] = field(default_factory=dict)
    proof: dict[str, str] = field(default_factory=dict)
    power: PowerConfig = field(default_factory=PowerConfig)
    runtime: LoopConfig = field(default_factory=LoopConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    mavlink: MavlinkConfig = field(default_factory=MavlinkConfig)
    web: WebConfig = field(default_factory=WebConfig)
    navigation: NavigationConfig = field(default_factory=NavigationConfig)
    localisation: LocalisationConfig = field(default_factory=LocalisationConfig)
    log: LogConfig = field(default_factory=LogConfig)
    odometry: MotionNoise = field(default_factory=MotionNoise)
    simulation: dict[str, Any] = field(default_factory=dict)

    @property
    def buses(self) -> tuple[CanConfig, ...]:
        """All buses, in the order of the file."""
        return self.can if isinstance(self.can, tuple) else (self.can,)

    @property
    def footprint(self) -> Footprint:
        """The outline of the body: that of the file, else the guard's rectangle."""
        return self.body.footprint or self.navigation.guard.outline(self.sonar)

    @property
    def footprints(self) -> tuple[Footprint, ...]:
        """The outline of the body in each of its states."""
        return self.body.footprints or (self.footprint,)

    @property
    def lidars(self) -> tuple[LidarConfig, ...]:
        """All lidars, in the order of the file."""
        if self.lidar is None:
            return ()
        return self.lidar if isinstance(self.lidar, tuple) else (self.lidar,)

    @property
    def motors(self) -> tuple[MotorConfig, ...]:
        """The motor drives: those of the file, else our own controller."""
        return self.motor or (native_motor(self.drive, self.nodes.get(NATIVE_NAME, "")),)

    @property
    def duty_wheels(self) -> tuple[str, ...]:
        """Names of the wheels whose drives take a duty, and whose speed loops are ours."""
        driven = {
            axis.actuator
            for motor in self.motors
            if motor.abilities.takes is Takes.DUTY
            for axis in motor.axes
        }
        return tuple(name for name in self.drive.wheel_names if name in driven)

    def bus_of(self, node: str) -> CanConfig:
        """Return the bus of a node, by its name."""
        name = self.nodes.get(node)
        return next((bus for bus in self.buses if bus.name == name), self.buses[0])

    @property
    def has_camera(self) -> bool:
        """Whether the robot has an enabled camera."""
        return self.camera is not None and self.camera.enabled


def config_directory() -> Path:
    """Return the folder of the built-in configurations."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "configs"
    return installed if installed.is_dir() else package.parent / "configs"


TOML: Final = (".toml",)
MAPS: Final = (".yaml", ".yml")
"""Suffixes of a ROS map."""

_KINDS: Final = {
    "": "robot's file", "missions": "mission", "worlds": "world", "scenarios": "scenario of faults",
    "places": "file of places", "campaigns": "campaign",
}  # fmt: skip


def find_file(
    given: str,
    folder: str = "",
    suffixes: Sequence[str] = TOML,
    *,
    beside: Path | None = None,
) -> Path:
    """Return the file of a path, or of a name with or without its suffix.

    It is searched for in the folder `beside`, that of the file which names it, then in the working
    directory, then among the built-in ones.

    Parameters
    ----------
    given
        The user's text.
    folder
        Folder of the built-in files of its kind: "" for robots, `missions`, `worlds`, `scenarios`.

    Raises
    ------
    ConfigError
        If there is no such file, with the nearest name; if the file is of another kind.
    """
    shipped = config_directory() / folder
    other_kind: ConfigError | None = None
    for place in (*([] if beside is None else [beside]), Path(), shipped):
        for candidate in (place / given, *(place / f"{given}{suffix}" for suffix in suffixes)):
            if candidate.is_file() or candidate.is_char_device():  # /dev/null: an empty one
                try:
                    _refuse_other_kind(candidate, folder, suffixes)
                except ConfigError as error:
                    # A mission may have the name of its world; each is searched for by its kind.
                    other_kind = other_kind or error
                else:
                    return candidate
    if other_kind is not None:
        raise other_kind
    path = Path(given)
    for other, kind in _KINDS.items():
        if other != folder and (config_directory() / other / f"{path.stem}.toml").is_file():
            raise ConfigError(f"{given}: is the name of a {kind}; a {_KINDS[folder]} is needed")
    names = [file.stem for file in sorted(shipped.glob("*.toml"))]
    raise ConfigError(
        f"{given}: no such file, and not in {shipped}{toml_source.nearest(path.stem, names)}"
    )


def _refuse_other_kind(file: Path, folder: str, suffixes: Sequence[str]) -> None:
    """Refuse a file of another kind than that of a folder; other errors are reported elsewhere.

    Raises
    ------
    ConfigError
        With the kind found and the kind needed.
    """
    if file.suffix.lower() in MAPS:
        if file.suffix.lower() not in suffixes:
            raise ConfigError(f"{file}: is a ROS map; a {_KINDS[folder]} is needed")
        return
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return
    found = _kind_of(data)
    if found is not None and found != folder:
        raise ConfigError(f"{file}: is a {_KINDS[found]}; a {_KINDS[folder]} is needed")


def _kind_of(data: Mapping[str, Any]) -> str | None:
    """Return the folder where a file of such tables would be; None if undetermined."""
    if isinstance(data.get("world"), dict):
        return "worlds"
    for folder, tables in (
        ("missions", {"item"}),
        ("scenarios", {"fault"}),
        ("places", {"mark", "place"}),
        ("campaigns", {"robots", "missions", "criteria", "seeds", "case"}),
        ("", {"drive", "robot"}),
    ):
        if tables & data.keys():
            return folder
    return None


def load_robot(path: Path, overrides: Sequence[str] = ()) -> RobotConfig:
    """Read and check a robot's file.

    Raises
    ------
    ConfigError
        With one line for each error.
    """
    return toml_source.load(path, RobotConfig, overrides, contradictions)


def robot_to_json(config: RobotConfig) -> str:
    """Return a validated configuration as JSON, which `robot_of_json` reads."""
    return json.dumps(msgspec.to_builtins(config))  # msgspec's own knows no infinity


def robot_of_json(text: str) -> RobotConfig:
    """Return the configuration that `robot_to_json` wrote.

    Raises
    ------
    ConfigError
        If another version of robotctl with an incompatible configuration wrote it.
    """
    try:
        data = json.loads(text)
    except ValueError as error:
        raise ConfigError(f"no JSON: {error}") from error
    config: RobotConfig = toml_source.restored(RobotConfig, data)
    return config


def camera_of(config: RobotConfig, file: Path) -> CameraConfig:
    """Return the camera of a robot with this file.

    Raises
    ------
    ConfigError
        If it has no camera.
    """
    if config.camera is None:
        raise ConfigError(
            f"{file}: no table [camera]; `robotctl camera calibrate` finds its values, "
            "docs/camera.md says how"
        )
    return config.camera


def contradictions(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield conflicts between keys: the key at fault and the reason."""
    yield from _wrong_loops(config)
    two_periods_ms = 2 * config.runtime.period_ns / 1e6
    if config.safety.command_timeout_ms < two_periods_ms:
        bound = f"under two control periods ({two_periods_ms:g} ms at {config.runtime.rate_hz} Hz)"
        yield ("safety", "command_timeout_ms"), f"{config.safety.command_timeout_ms} is {bound}"
    yield from _wrong_buses(config)
    yield from fitting_problems(config.drive, config.motors)
    yield from _out_of_order(config)
    if config.mavlink.gcs_system_id == config.mavlink.system_id:
        problem = f"{config.mavlink.gcs_system_id} found, which is the robot's own system_id"
        yield ("mavlink", "gcs_system_id"), problem
    two_steps_ms = 2e3 / config.navigation.rate_hz
    if config.safety.setpoint_timeout_ms < two_steps_ms:
        rate_hz = config.navigation.rate_hz
        bound = f"under two steps of navigation ({two_steps_ms:g} ms at {rate_hz:g} Hz)"
        yield ("safety", "setpoint_timeout_ms"), f"{config.safety.setpoint_timeout_ms} is {bound}"
    yield from _beyond_the_limits(config)
    yield from _beyond_the_body(config)
    yield from _beyond_the_nose(config)
    names = [mount.name for mount in config.sonar]
    for name in sorted({name for name in names if names.count(name) > 1}):
        second = names.index(name, names.index(name) + 1)
        rule = f"must differ from those before, found {name!r}"
        yield ("sonar", second, "name"), f"{rule}, which is given {names.count(name)} times"
    if len(names) > MAX_SONARS:
        problem = f"the bus carries at most {MAX_SONARS} sonars, found {len(names)}"
        yield ("sonar", MAX_SONARS), problem
    yield from _wrong_lidars(config)
    if config.log.pictures_every_s and not config.has_camera:
        yield ("log", "pictures_every_s"), "needs camera.enabled = true"
    settings = config.localisation
    if localiser_kind(settings.method).needs_map and not settings.map:
        problem = "needs localisation.map, a world (.toml) or a ROS map (.yaml)"
        yield ("localisation", "method"), f'"{settings.method}" {problem}'


def _wrong_loops(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield missing and superfluous settings of the wheels whose speed loops are ours."""
    for name, problem in config.control.wrong_loops(config.duty_wheels):
        yield ("control", name), problem
    for name in OF_DUTY_WHEELS if config.duty_wheels else ():
        if getattr(config.plausibility, name) is None:
            yield ("plausibility", name), "missing"


def _wrong_buses(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield duplicate buses, and nodes on unknown buses."""
    buses = config.buses
    if not buses:
        yield ("can",), "must be a table or a list of tables, one for each bus, found []"
    for number, bus in enumerate(buses):
        before = buses[:number]
        if bus.name in [each.name for each in before]:
            rule = "must differ from those before, since nodes and drives name their bus"
            yield ("can", number, "name"), f"{rule}, found {bus.name!r}"
        if (bus.interface, bus.channel) in [(each.interface, each.channel) for each in before]:
            rule = "must differ from those before, found"
            yield ("can", number, "channel"), f"{rule} {bus.interface} {bus.channel!r}"
    known = [*(() if config.motor else (NATIVE_NAME,)), *(node.name for node in CAN_NODES)]
    for node, name in config.nodes.items():
        if node not in known:
            yield ("nodes", node), f"no such node{toml_source.nearest(node, known)}"
        elif problem := bus_problem(name, buses):
            yield ("nodes", node), problem
    yield from _wrong_drives(config)


def _wrong_lidars(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield lidars of one name, on one line, or of two programs, which would share a socket."""
    for number, lidar in enumerate(config.lidars):
        before = config.lidars[:number]
        if lidar.name in [each.name for each in before]:
            problem = f"must differ from those before, found {lidar.name!r}"
            yield ("lidar", number, "name"), problem
        if before and (lidar.driver == SOCKET) != (before[0].driver == SOCKET):
            problem = f"{lidar.driver!r} found, beside {before[0].driver!r} of the first"
            yield ("lidar", number, "driver"), f"{problem}: one program publishes all scans"
        elif lidar.driver != SOCKET and lidar.device in [each.device for each in before]:
            problem = f"must differ from those before, found {lidar.device!r}"
            yield ("lidar", number, "device"), problem


def _wrong_drives(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield drives on unknown buses, and a supply that no drive reports."""
    names = [motor.name for motor in config.motors]
    for name in config.proof:
        if name not in names:
            yield ("proof", name), f"no such drive{toml_source.nearest(name, names)}"
    silent = [each.name for each in config.motors if not each.abilities.tells_voltage]
    if config.power.source == "drives" and len(silent) == len(config.motors):
        yield ("power", "source"), f"'drives' found, but {', '.join(silent)} tell no voltage"
    for number, motor in enumerate(config.motor):
        if motor.bus and (problem := bus_problem(motor.bus, config.buses)):
            yield ("motor", number, "bus"), problem


def bus_problem(name: str, buses: Sequence[CanConfig]) -> str:
    """Return the problem of a bus name; empty if the bus exists."""
    names = [bus.name for bus in buses]
    return "" if name in names else f"no bus {name!r}{toml_source.nearest(name, names)}"


def _out_of_order(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield minimum values above their maximum."""
    pursuit = config.navigation.pursuit
    for least, greatest in (
        ("lookahead_min_m", "lookahead_max_m"),
        ("turned_deg", "turn_on_spot_deg"),
    ):
        value, most = getattr(pursuit, least), getattr(pursuit, greatest)
        if value > most:
            problem = f"{value:g} found, at most {greatest} ({most:g}) allowed"
            yield ("navigation", "pursuit", least), problem


def _beyond_the_limits(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield plans that exceed the robot's limits."""
    limits, navigation = config.limits, config.navigation
    planned = (
        (("guard", "deceleration_m_s2"), navigation.guard.deceleration_m_s2, "a_max_m_s2"),
        (("pursuit", "acceleration_m_s2"), navigation.pursuit.acceleration_m_s2, "a_max_m_s2"),
        (("pursuit", "alpha_rad_s2"), navigation.pursuit.alpha_rad_s2, "alpha_max_rad_s2"),
    )
    for key, value, limit in planned:
        most = getattr(limits, limit)
        if value > most:
            yield ("navigation", *key), f"{value} found, at most limits.{limit} ({most}) allowed"
    guard = navigation.guard
    step_s = 1.0 / navigation.rate_hz
    # The last part is the limiter's lag behind a speed that falls evenly.
    late_s = 0.5 * guard.deceleration_m_s2 / limits.jerk_max_m_s3
    least_s = max(RING_S, step_s) + step_s + late_s
    if config.sonar and guard.reaction_s < least_s:
        problem = (
            f"{guard.reaction_s} found, but from the first of two readings to the brakes pass "
            f"{least_s:.3f} s and more (navigation.rate_hz {navigation.rate_hz:g}, "
            f"limits.jerk_max_m_s3 {limits.jerk_max_m_s3:g})"
        )
        yield ("navigation", "guard", "reaction_s"), problem
    back_emf_v_s_rad = config.plausibility.back_emf_v_s_rad
    if config.duty_wheels and back_emf_v_s_rad is not None:
        yield from _beyond_the_motors(config, back_emf_v_s_rad)
        yield from _hidden_run_away(config, back_emf_v_s_rad)
    yield from _unreadable_counts(config)
    drive, monitor = config.drive, config.plausibility
    if not drive.joint_names:
        return
    tolerance_rad, most_rad = monitor.steering_tolerance_rad, min(drive.joint_max_rad)
    if tolerance_rad >= most_rad:
        problem = f"{tolerance_rad} found, less than drive.steering_max_rad ({most_rad}) allowed"
        yield ("plausibility", "steering_tolerance_rad"), problem
    way_rad = 2.0 * max(drive.joint_max_rad) - monitor.steering_tolerance_rad
    least_ms = 1000.0 * way_rad / min(drive.joint_rate_max_rad_s)
    if monitor.steering_ms < least_ms:
        problem = f"the steering needs {least_ms:.0f} ms from one end to near the other"
        yield ("plausibility", "steering_ms"), f"{monitor.steering_ms} found, but {problem}"


def _beyond_the_body(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield sonars outside of the outline, and what else tells the body than that."""
    body = config.body
    if not body.outline:
        return
    for number, part in enumerate(body.part):
        for name in set(part.states).difference(body.states):
            hint = toml_source.nearest(name, body.states)
            yield ("body", "part", number, "states"), f"no such state {name!r}{hint}"
    guard, unset = config.navigation.guard, GuardConfig()
    for name in ("nose_m", "half_width_m"):
        if getattr(guard, name) != getattr(unset, name):
            problem = f"{getattr(guard, name):g} found beside [body] outline, which tells the body"
            yield ("navigation", "guard", name), f"{problem}; leave one out"
    for mount in config.sonar:
        outside_m = max(-each.depth_m(mount.x_m, mount.y_m) for each in body.footprints)
        if outside_m > OUTSIDE_M:
            problem = (
                f"sonar {mount.name} at {mount.x_m:g}, {mount.y_m:g} is {outside_m:.3f} m outside"
            )
            yield ("body", "outline"), f"{problem}; what moves with the robot belongs inside"


def _beyond_the_nose(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield a nose with a protruding sonar: camera obstacles would be reached too early."""
    if config.camera is None or not config.sonar or config.body.outline:
        return
    nose_m = config.navigation.guard.nose_m
    foremost = max(config.sonar, key=lambda mount: mount.x_m)
    if nose_m < foremost.x_m:
        problem = (
            f"{nose_m:g} found, but sonar {foremost.name} is {foremost.x_m:g} m ahead of base, "
            "and the gap to camera obstacles is measured from nose_m"
        )
        yield ("navigation", "guard", "nose_m"), problem


def _beyond_the_motors(
    config: RobotConfig, back_emf_v_s_rad: float
) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield demands that no motor can meet, and those that exceed the bridges' slew rate."""
    limits = config.limits
    fastest_rad_s = fastest_wheel_rad_s(config.drive, limits)
    needed_v = back_emf_v_s_rad * fastest_rad_s
    if needed_v > MAX_SUPPLY_V:
        problem = (
            f"{limits.v_max_m_s:g} found with omega_max_rad_s {limits.omega_max_rad_s:g}, where "
            f"a wheel turns at {fastest_rad_s:.0f} rad/s and its motor needs {needed_v:.0f} V; at "
            f"most {MAX_SUPPLY_V} V allowed, see the units of [limits] and [drive]"
        )
        yield ("limits", "v_max_m_s"), problem
    pwm, deceleration_m_s2 = config.control.pwm, config.navigation.guard.deceleration_m_s2
    supply_v = max(needed_v, pwm.min_bus_voltage_v)  # the real one is not known here
    slew_rad_s2 = pwm.slew_per_s * supply_v / back_emf_v_s_rad
    most_m_s2 = slew_rad_s2 * min(config.drive.wheel_radii_m)
    if most_m_s2 < deceleration_m_s2:
        problem = (
            f"{pwm.slew_per_s:g} found, which brakes the robot by {most_m_s2:.2g} m/s^2 at "
            f"{supply_v:.1f} V, but navigation.guard.deceleration_m_s2 is {deceleration_m_s2:g}"
        )
        yield ("control", "pwm", "slew_per_s"), problem


def _hidden_run_away(
    config: RobotConfig, back_emf_v_s_rad: float
) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield a tolerance so wide that a motor with a stuck encoder could run away."""
    drive, monitor = config.drive, config.plausibility
    # Any motor is at least this fast: it reaches the limits, and the supply has a floor.
    motor_rad_s = max(
        config.limits.v_max_m_s / max(drive.wheel_radii_m),
        config.control.pwm.min_bus_voltage_v / back_emf_v_s_rad,
    )
    most_rad_s = FOUND_SHARE * motor_rad_s * (1.0 - monitor.speed_tolerance_share)
    if monitor.speed_tolerance_rad_s > most_rad_s:
        problem = (
            f"{monitor.speed_tolerance_rad_s:g} found, at most {math.floor(1e3 * most_rad_s) / 1e3}"
            f" allowed: a stuck encoder must show at half the {motor_rad_s:.2g} rad/s that the "
            "motor reaches"
        )
        yield ("plausibility", "speed_tolerance_rad_s"), problem


def _unreadable_counts(config: RobotConfig) -> Iterator[tuple[toml_source.Key, str]]:
    """Yield an encoder too fine for a lost frame, or too coarse for its monitor."""
    monitor, counts = config.plausibility, config.drive.counts_per_revolution
    gap_s = (config.safety.feedback_timeout_periods + 1) * config.runtime.period_ns * 1e-9
    way_rad = impossible_wheel_rad_s(config.drive, config.limits) * gap_s
    most = math.floor(math.tau / max(way_rad / STEP_MAX, FINEST_RAD))
    if counts > most:
        problem = (
            f"{counts} found, at most {most} allowed: after more than {STEP_MAX} counts within "
            f"{1e3 * gap_s:g} ms, which safety.feedback_timeout_periods lets pass, a wheel seems "
            "to turn backwards"
        )
        yield ("drive", "counts_per_revolution"), problem
    # A single count in the window reads as this speed. Under an acceleration a, the speed lags by
    # the wheel's gain in one count, sqrt(2 a rad_per_count). Beyond `shown_rad_s` both are faults.
    shown_rad_s = monitor.speed_tolerance_rad_s / (1.0 - monitor.speed_tolerance_share)
    gained_rad = shown_rad_s**2 * min(config.drive.wheel_radii_m) / (2.0 * config.limits.a_max_m_s2)
    rad_per_count = min(WINDOW_S * shown_rad_s, gained_rad)
    least = math.ceil(math.tau / max(rad_per_count, FINEST_RAD))
    if counts < least:
        problem = (
            f"{counts} found, at least {least} allowed: one count makes a healthy wheel differ "
            "from its motor by more than plausibility.speed_tolerance_rad_s "
            f"({monitor.speed_tolerance_rad_s:g}) lets pass, at rest or at limits.a_max_m_s2 "
            f"({config.limits.a_max_m_s2:g})"
        )
        yield ("drive", "counts_per_revolution"), problem
