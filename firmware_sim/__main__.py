"""`python -m firmware_sim`: the simulated robot as a process of its own, in real time.

SIGTERM, SIGINT and the end of its parent end it; SIGHUP, like a restart of the program,
power-cycles all nodes.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from firmware_sim.bus.bridge import Bridge
from firmware_sim.bus.hub import Hub, HubError
from firmware_sim.bus.log import LogWriter
from firmware_sim.bus.serve import Service
from firmware_sim.camera.process import CameraProcess
from firmware_sim.command_line import (
    POSE,
    WORLD,
    Parser,
    file_among,
    parse_natural,
    parse_pose,
    tell,
)
from firmware_sim.config.config import load_robot, parse_override
from firmware_sim.errors import SimulationError
from firmware_sim.nodes.node import NmtState
from firmware_sim.pace import SharedClock
from firmware_sim.parent import end_with_parent
from firmware_sim.world.clutter import add_options, load_cluttered
from firmware_sim.world.manner import STUBBORN, parse_manners
from firmware_sim.world.publisher import Publisher
from native_kernels.cache import cache_of
from native_kernels.library import found_library

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from firmware_sim.simulation import Simulation

SIMCAN = "simcan"
NOT_KEPT = (
    "note: no folder takes the compiled code, so each start compiles for half a minute; "
    "NUMBA_CACHE_DIR=FOLDER names one that does"
)
STREAMS = ("truth", "lidar", "camera")
_CAN_LINK_TYPE = "280"
"""ARPHRD_CAN of linux/if_arp.h."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = Parser(
        prog="python -m firmware_sim", description="Run a simulated robot on a CAN bus."
    )
    add = result.add_argument
    add("--robot", type=file_among("", ".toml"), required=True, help="TOML of the robot, or a name")
    add("--world", type=WORLD, required=True, help="TOML of the room or a ROS map.yaml, or a name")
    add(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace one value of the robot's TOML, e.g. simulation.battery.charge=0.7",
    )
    add(
        "--bus",
        action="append",
        help="simcan:CHANNEL or a CAN interface (simcan:simcan0); once for each bus of the robot, "
        "in their order",
    )
    add("--seed", type=parse_natural, default=0, help="of all random draws (%(default)s)")
    add("--people", type=parse_natural, default=0, help="who walk about (%(default)s)")
    add(
        "--manner",
        type=parse_manners,
        default=STUBBORN,
        metavar="NAME",
        help="how they walk: stubborn, evades, wanders, runs, several with commas, or mixed",
    )
    add_options(add)
    add("--start", type=parse_pose, metavar=POSE, help="instead of the world's start pose")
    add("--state", type=Path, metavar="DIR", help="keep stored parameters here")
    add("--truth", metavar="ADDRESS", help="publish the ground truth at ipc:///PATH")
    add("--lidar", metavar="ADDRESS", help="publish the lidar's scans at ipc:///PATH")
    add("--camera", metavar="ADDRESS", help="publish the camera's pictures at ipc:///PATH")
    add("--log", type=Path, metavar="FILE", help="write a candump log")
    add(
        "--log-mb",
        type=_megabytes,
        default=math.inf,
        metavar="MB",
        help="go on in the next number after so much, FILE-0002 after FILE or FILE-0001 (never)",
    )
    add(
        "--epoch-ns",
        type=int,
        default=time.time_ns() - time.monotonic_ns(),
        metavar="NS",
        help="added to CLOCK_MONOTONIC to get the times of --log (the wall clock's)",
    )
    add(
        "--faults",
        type=file_among("scenarios", ".toml"),
        metavar="FILE",
        help="TOML of the faults that befall the robot, or a name",
    )
    add("--duration", type=_seconds, default=math.inf, metavar="S", help="end after this time")
    add(
        "--clock",
        type=Path,
        metavar="FILE",
        help="go by a clock, shared in this file, that waits for this computer",
    )
    add("--priority", type=_priority, default=0, help="of SCHED_FIFO, 1..99, where permitted (off)")
    return result


def _priority(text: str) -> int:
    priority = parse_natural(text)
    if priority > 99:
        raise argparse.ArgumentTypeError(f"{text!r} is not in 0..99")
    return priority


def _seconds(text: str) -> float:
    return _positive(text, "seconds")


def _megabytes(text: str) -> float:
    return _positive(text, "megabytes")


def _positive(text: str, unit: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no positive number of {unit}")
    return value


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status: 0, or 2 on bad input."""
    # Faults are read from standard input, even from a terminal shared with other programs.
    signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    signals = _Signals()
    end_with_parent()
    try:
        options = parser().parse_args(arguments)
        options.bus = options.bus or ["simcan:simcan0"]
        _run(options, signals)
    except (SimulationError, HubError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


class _Signals(list[int]):
    """Signals for the loop; before it runs, SIGTERM and SIGINT end the process at once.

    Compilation takes half a minute, in which nothing else reads them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.awaited = False
        """Whether the loop handles them."""
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._on_signal)

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if not self.awaited and number != signal.SIGHUP:
            sys.exit(0)
        self.append(number)


def _run(options: argparse.Namespace, signals: _Signals) -> None:
    # These may load numba; its absence is reported like other errors.
    from firmware_sim.fault_console import FaultConsole  # noqa: PLC0415
    from firmware_sim.faults.scenario import Scenario, load_scenario, play  # noqa: PLC0415
    from firmware_sim.realtime import RealTime  # noqa: PLC0415
    from firmware_sim.simulation import Simulation  # noqa: PLC0415

    if not cache_of("firmware_sim").folder and found_library("firmware_sim") is None:
        sys.stderr.write(f"{NOT_KEPT}\n")
    for bus in options.bus:
        _check_bus(bus)
    _check_addresses(options)
    robot = load_robot(options.robot, dict(parse_override(text) for text in options.set))
    _check_count(options, [bus.name for bus in robot.buses])
    scenario = load_scenario(options.faults, robot) if options.faults else Scenario()
    if options.state is not None:
        _make_directory(options.state)
    world = load_cluttered(
        options.world, options.start, options.clutter, options.seed, options.keep_clear
    )
    simulation = Simulation(
        robot,
        world,
        options.seed,
        state_directory=options.state,
        people=options.people,
        manners=options.manner,
    )
    if options.lidar is not None and not simulation.config.simulation.lidars:
        raise SimulationError(f"--lidar: {options.robot} has no table [simulation.lidar]")
    if options.camera is not None and simulation.config.camera is None:
        raise SimulationError(f"--camera: {options.robot} has no table [camera]")
    simulation.warm()
    with ExitStack() as stack:
        services, channels = _open_buses(simulation, options.bus, stack)
        clock = stack.enter_context(closing(_open_clock(options.clock))) if options.clock else None
        loop = RealTime(simulation, [*services, FaultConsole(simulation)], clock)
        if options.truth is not None:
            loop.publish_truth(stack.enter_context(Publisher(options.truth)))
        if options.lidar is not None:
            loop.publish_scans(stack.enter_context(Publisher(options.lidar)))
        if options.camera is not None:
            loop.take_pictures(stack.enter_context(CameraProcess(_camera_arguments(options))))
        if options.log:
            log = stack.enter_context(_open_log(simulation, options, channels))
            loop.write_log(log, options.epoch_ns)
        play(scenario, simulation.faults, _announce_fault)
        _announce_when_booted(simulation, options)
        signals.awaited = True
        loop.run(lambda: _finished(simulation, signals, options.duration), options.priority)


def _check_addresses(options: argparse.Namespace) -> None:
    """Raise SimulationError if two streams have one address: one of them would be lost."""
    there: dict[str, str] = {}
    for stream in STREAMS:
        address = getattr(options, stream)
        if address in there:
            raise SimulationError(f"--{stream}: {address}: is that of --{there[address]} already")
        if address is not None:
            there[address] = stream


def _make_directory(path: Path) -> None:
    """Make the folder of stored parameters, private to the user."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise SimulationError(f"--state {path}: not a directory") from None
    except OSError as error:
        raise SimulationError(f"--state {path}: cannot be created: {error.strerror}") from error


def _camera_arguments(options: argparse.Namespace) -> list[str]:
    """Options of the camera's process: robot, world, seed and address of this one."""
    arguments = [f"--{key}={getattr(options, key)}" for key in ("robot", "world", "seed", "camera")]
    clock = [f"--clock={options.clock}"] if options.clock else []
    if options.start is not None:
        x_m, y_m, theta_rad = options.start
        arguments.append(f"--start={x_m},{y_m},{math.degrees(theta_rad)}")
    arguments.append(f"--clutter={options.clutter}")
    arguments += [f"--keep-clear={x_m},{y_m}" for x_m, y_m in options.keep_clear]
    return [*arguments, *clock, *(f"--set={text}" for text in options.set)]


def _open_clock(path: Path) -> SharedClock:
    try:
        return SharedClock(path)
    except OSError as error:
        raise SimulationError(f"--clock {path}: cannot be created: {error.strerror}") from error


def _open_log(
    simulation: Simulation, options: argparse.Namespace, channels: Sequence[str]
) -> LogWriter:
    first, *others = zip(simulation.buses.values(), channels, strict=True)
    try:
        log = LogWriter(first[0], options.log, first[1], file_bytes=options.log_mb * 1e6)
    except OSError as error:
        raise SimulationError(f"--log: {error}") from error
    for bus, channel in others:
        log.add(bus, channel)
    return log


def _check_count(options: argparse.Namespace, names: Sequence[str]) -> None:
    """Raise SimulationError unless there is a --bus for each bus of the robot."""
    if len(options.bus) != len(names):
        raise SimulationError(
            f"--bus: {len(options.bus)} given, but {options.robot} has {len(names)} "
            f"({', '.join(names)}); give one for each, in this order"
        )
    if len(set(options.bus)) < len(names):
        raise SimulationError(f"--bus: {', '.join(options.bus)}: each bus needs its own")


def _open_buses(
    simulation: Simulation, names: Sequence[str], stack: ExitStack
) -> tuple[list[Service], list[str]]:
    """Return hubs or bridges of the buses, open as long as `stack`, and the buses' log names."""
    services: list[Service] = []
    channels = []
    for bus, name in zip(simulation.buses.values(), names, strict=True):
        service, channel = _open_bus(bus, name)
        services.append(stack.enter_context(closing(service)))
        channels.append(channel)
    return services, channels


def _open_bus(bus: Bus, name: str) -> tuple[Hub | Bridge, str]:
    """Return the hub or bridge of a bus, and its name in a log."""
    channel = name.partition(":")[2]
    try:
        if channel:
            return Hub(bus, channel), Path(channel).stem
        return Bridge.open(bus, name), name
    except (OSError, ValueError) as error:
        raise SimulationError(f"--bus {name}: {error}") from error


def _check_bus(name: str) -> None:
    """Raise SimulationError, with a remedy, if `name` cannot be a bus here."""
    interface, colon, channel = name.partition(":")
    if colon or not name:
        if interface != SIMCAN or not channel:
            raise SimulationError(f"--bus {name}: allowed are simcan:CHANNEL or a CAN interface")
        return
    classes = Path("/sys/class/net")
    if not classes.is_dir():
        return
    links = sorted(
        each.parent.name
        for each in classes.glob("*/type")
        if each.read_text(encoding="ascii").strip() == _CAN_LINK_TYPE
    )
    if name not in links:
        there = f"there are {', '.join(links)}" if links else "there are none"
        raise SimulationError(
            f"--bus {name}: no such CAN interface, {there}; make it with "
            f"`ip link add dev {name} type vcan && ip link set {name} up`, or use simcan:simcan0 "
            "where the kernel has no CAN"
        )


def _announce_when_booted(simulation: Simulation, options: argparse.Namespace) -> None:
    """Print the ready line once the nodes have booted."""
    bus = simulation.bus
    addresses = [
        f"{key}={getattr(options, key)}" for key in STREAMS if getattr(options, key) is not None
    ]

    def look() -> None:
        if all(node.state is not NmtState.INITIALISING for node in simulation.nodes):
            tell(" ".join(["ready", *options.bus, *addresses]))
        else:
            bus.schedule(bus.now_ns + 1_000_000, look)

    bus.schedule(bus.now_ns, look)


def _announce_fault(line: str) -> None:
    """Print that a fault of the scenario has begun."""
    tell(f"fault at {line}")


def _finished(simulation: Simulation, signals: list[int], duration_s: float) -> bool:
    """Handle received signals; return whether to end."""
    if signal.SIGHUP in signals:
        signals.remove(signal.SIGHUP)
        simulation.power_cycle()
    if signal.SIGTERM in signals or signal.SIGINT in signals:
        return True
    return simulation.now_ns >= duration_s * 1e9


if __name__ == "__main__":
    sys.exit(main())
