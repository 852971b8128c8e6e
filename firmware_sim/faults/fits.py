"""Arguments of a fault that do not fit a robot, though the bounds of the catalogue allow them.

A fault without effect on a robot would let its test pass without having been applied. Each function
yields the key, its problem, and what this robot allows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from firmware_sim.bus.frame import EXTENDED_FLAG, FD_FLAG
from firmware_sim.config.motors import OWN_KIND
from firmware_sim.drives.config import Guard, MotorSection
from firmware_sim.drives.registry import true_drive
from firmware_sim.errors import nearest
from firmware_sim.faults.parameters import Arguments, shown
from firmware_sim.nodes import drive_objects, power, sonar, standard_objects, wire
from firmware_sim.nodes.kinds import NODES, has_own_controller

if TYPE_CHECKING:
    from firmware_sim.config.config import RobotConfig

Misfits: TypeAlias = Iterator[tuple[str, str]]
Fits: TypeAlias = "Callable[[RobotConfig, Arguments], Misfits]"

KIND: Final = "kind"
"""The key to blame if no argument fits."""

PARAMETERS: Final = {
    "command_timeout": ("drive", drive_objects.COMMAND_TIMEOUT, 0),
    "current_limit": ("drive", drive_objects.CURRENT_LIMIT, 0),
    "temperature_limit": ("drive", drive_objects.TEMPERATURE_LIMIT, 0),
    "voltage_limit": ("drive", drive_objects.VOLTAGE_LIMIT, 0),
    "motor_status_syncs": ("drive", drive_objects.MOTOR_STATUS_PDO, 2),
    "drive_status_syncs": ("drive", drive_objects.DRIVE_STATUS_PDO, 2),
    "drive_heartbeat": ("drive", standard_objects.HEARTBEAT_TIME, 0),
    "ring_period": ("sonar", sonar.RING_PERIOD, 0),
    "battery_low": ("power", power.LOW_LIMIT, 0),
    "battery_critical": ("power", power.CRITICAL_LIMIT, 0),
}
"""Stored settings of nodes that the host relies on: node and object."""

PLACES: Final = {"left": 0, "right": 1, "drive": 0}
"""Wheel numbers of names, for robots without a wheel of that name."""

FULL_CELL_V: Final = 4.2
"""Voltage of a full cell [V], as in `firmware_sim.plant.battery`, whose import loads numba."""


def anything(_robot: RobotConfig, _arguments: Arguments) -> Misfits:
    """Yield nothing: the fault fits every robot."""
    return iter(())


def wheels(robot: RobotConfig) -> dict[str, int]:
    """Return the numbers of a robot's wheels by all their names in faults.

    `left`, `right` and `drive` are the first, the second and the first wheel if no wheel has that
    name itself.
    """
    names = {name: number for number, name in enumerate(robot.drive.wheel_names)}
    places = {name: number for name, number in PLACES.items() if number < len(names)}
    return names | {name: number for name, number in places.items() if name not in names}


def wheel(robot: RobotConfig, arguments: Arguments, key: str = "wheel") -> Misfits:
    """Yield a misfit if the robot has no such wheel."""
    there = wheels(robot)
    if arguments[key] not in there:
        rule = f"the {robot.drive.kind} drive has no such wheel"
        hint = nearest(str(arguments[key]), there)
        yield key, f"{shown(str(arguments[key]))!r}, {rule}, allowed: {', '.join(there)}{hint}"


def exchange(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit unless the robot has two such wheels with encoders that can be swapped."""
    if len(robot.drive.wheel_names) < 2:
        yield KIND, f"the {robot.drive.kind} drive has one motor, whose encoder has no other socket"
        return
    misfits = [each for key in ("wheel", "other") for each in wheel(robot, arguments, key)]
    yield from misfits
    one, other = (wheels(robot).get(str(arguments[key])) for key in ("wheel", "other"))
    if not misfits and one == other:
        yield "other", f"{arguments['other']!r}, must be another wheel"


def body(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot's body has no such state."""
    states, given = robot.body.states, str(arguments["state"])
    if not states:
        yield KIND, "the robot's file has no states in [body]"
    elif given not in states:
        hint = nearest(given, states)
        yield "state", f"{shown(given)!r}, allowed: {', '.join(states)}{hint}"


def sonars(robot: RobotConfig, _arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no sonar."""
    if not robot.sonar:
        yield KIND, "the robot has no sonars"


def crosstalk(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no such sonars, or they do not fire together."""
    yield from sonars(robot, arguments)
    count = len(robot.sonar)
    numbers = {key: int(float(arguments[key])) for key in ("sonar", "other")}
    missing = [key for key, number in numbers.items() if number >= count > 0]
    for key in missing:
        yield key, f"{numbers[key]}, the robot has {count} sonars, allowed: 0 to {count - 1}"
    if missing or not count:
        return
    listener, speaker = numbers["sonar"], numbers["other"]
    first = listener // sonar.GROUP_SIZE * sonar.GROUP_SIZE
    group = [
        each for each in range(first, min(first + sonar.GROUP_SIZE, count)) if each != listener
    ]
    if speaker not in group:
        allowed = ", ".join(map(str, group)) or "none"
        rule = f"must be another that fires together with sonar {listener}"
        yield "other", f"{speaker}, {rule}, allowed: {allowed}"


def frames(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if no frame of the robot or its host has the identifier; 0 is any."""
    given, there = int(float(arguments["id"])), identifiers(robot)
    if given == 0 or given in there:
        return
    marked = given | EXTENDED_FLAG
    near = marked if marked in there else min(there, key=lambda each: abs(each - given))
    allowed = ", ".join(f"{each:#05x}" for each in sorted(there))
    yield (
        "id",
        f"{given:#05x}, nobody sends it, nearest is {near:#05x}; allowed: 0 for any, {allowed}",
    )


def identifiers(robot: RobotConfig) -> dict[int, int]:
    """Return the identifiers of a robot as on its buses, except NMT's, which is 0.

    The keys are without the flag of CAN FD, as users write them.
    """
    bought = (frame for drive, _ in _bought(robot) for frame in drive.frames)
    return {frame & ~FD_FLAG: frame for frame in (*_own_identifiers(robot), *bought)}


def _own_identifiers(robot: RobotConfig) -> set[int]:
    nodes = [kind for kind in NODES if kind.is_there(robot)]
    commands = {wire.MOTOR_COMMAND} if has_own_controller(robot) else set()
    bases = (
        wire.EMERGENCY_BASE, wire.SDO_RESPONSE_BASE, wire.SDO_REQUEST_BASE, wire.HEARTBEAT_BASE,
    )  # fmt: skip
    return {
        wire.EMERGENCY_STOP, wire.SYNC, *commands,
        *(frame for kind in nodes for frame in kind.frames(robot)),
        *(base + kind.node_id for base in bases for kind in nodes),
    }  # fmt: skip


def _bought(robot: RobotConfig) -> list[tuple[MotorSection, Any]]:
    """Return the true drives of a robot that are not ours, and the settings of their twins."""
    twins = robot.simulation.twin
    return [
        true_drive(motor, twins.get(motor.name, {}))
        for motor in robot.motors
        if motor.kind != OWN_KIND
    ]


def nodes(robot: RobotConfig) -> list[str]:
    """Return the names of a robot's nodes, ours and bought drives."""
    ours = [kind.name for kind in NODES if kind.is_there(robot)]
    return ours + [drive.name for drive, _ in _bought(robot)]


def _one_of(key: str, arguments: Arguments, there: list[str]) -> Misfits:
    name = str(arguments[key])
    if name not in there:
        allowed = ", ".join(there) or "none"
        yield key, f"{shown(name)!r}, the robot has none, allowed: {allowed}{nearest(name, there)}"


def node(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no such node."""
    return _one_of("node", arguments, nodes(robot))


def own_node(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no such node of ours."""
    return _one_of("node", arguments, [kind.name for kind in NODES if kind.is_there(robot)])


def drive_fault(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no such bought drive, or that has no such code."""
    drives = {drive.name: drive for drive, _ in _bought(robot)}
    misfits = list(_one_of("drive", arguments, list(drives)))
    yield from misfits
    code = int(float(arguments["code"]))
    if not misfits and code not in (codes := drives[str(arguments["drive"])].FAULT_CODES):
        yield "code", f"{code}, allowed: {codes.start} to {codes.stop - 1}"


def _guarded(guard: Guard) -> Fits:
    """Return a function that yields a misfit for an unknown wheel, or one without this guard."""

    def fits(robot: RobotConfig, arguments: Arguments) -> Misfits:
        misfits = list(wheel(robot, arguments))
        yield from misfits
        if misfits:
            return
        name = robot.drive.wheel_names[wheels(robot)[str(arguments["wheel"])]]
        for drive, settings in _bought(robot):
            turned = {axis.actuator for axis in drive.axes}
            if name in turned and guard not in drive.guards(settings):
                yield KIND, f"{drive.name} does not guard itself by {guard.value}"

    return fits


current, heat = _guarded(Guard.CURRENT), _guarded(Guard.HEAT)


def imu(robot: RobotConfig, _arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no IMU."""
    if not robot.imu.enabled:
        yield KIND, "the robot has no IMU: imu.enabled is false"


def sag(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the battery never has more than the remaining voltage."""
    battery = robot.simulation.battery
    full_v = battery.cells * FULL_CELL_V * battery.voltage_scale
    volts = float(arguments["volts"])
    if volts >= full_v:
        yield "volts", f"{volts:g}, the battery has {full_v:g} V, allowed: less"


def controller(robot: RobotConfig, _arguments: Arguments) -> Misfits:
    """Yield a misfit unless a motor controller of ours drives the robot."""
    if not has_own_controller(robot):
        yield KIND, "the robot has no motor controller of this kind"


def parameter(robot: RobotConfig, arguments: Arguments) -> Misfits:
    """Yield a misfit if the robot has no node with such a parameter."""
    name = str(arguments["parameter"])
    node_name, _, _ = PARAMETERS[name]
    if misfits := list(own_node(robot, {"node": node_name})):
        yield "parameter", f"{name!r}, of {misfits[0][1]}"
