"""`robotctl can`: the bus-load budget, and who is on the bus."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.table import Table

from robotctl.cli.console import plain_console
from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile, robot_file
from robotctl.errors import ConfigError, InvalidValue
from robotctl.messages.ports import EXTENDED_FLAG

if TYPE_CHECKING:
    from robotctl.config.robot_file import RobotConfig
    from robotctl.drivers.can.bus_load import BusLoad, Cyclic
    from robotctl.drivers.can.config import CanConfig

app = typer.Typer(no_args_is_help=True)

OVER_BUDGET = TO_BE_MENDED = 1


@app.callback()  # without one, a single subcommand would be the command itself
def can() -> None:
    """Load of the CAN bus, and the devices on it."""


@app.command("budget")
@takes_options
def show_budget(robot: RobotFile = DEFAULT_ROBOT, overrides: Overrides = ()) -> None:
    """Print the worst-case load of each cyclic frame; status 1 where a bus is over 50 %."""
    from robotctl.config.robot_file import config_directory, load_robot  # noqa: PLC0415
    from robotctl.drivers.can.bus_load import DRIVE, MAX_LOAD, budget  # noqa: PLC0415
    from robotctl.drivers.can.dbc import load_dbc  # noqa: PLC0415
    from robotctl.drivers.can.nodes.registry import CAN_NODES  # noqa: PLC0415

    config = load_robot(robot, overrides)
    dbc = load_dbc(config_directory() / "robot.dbc")
    console = plain_console()
    loads = []
    for bus in config.buses:
        foreign, ours = _on_bus(config, bus)
        load = budget(
            dbc,
            config.runtime.rate_hz,
            bus,
            sonars=len(config.sonar),
            steered=bool(config.drive.joint_names),
            imu=config.imu.enabled,
            elsewhere={DRIVE, *(each.name.upper() for each in CAN_NODES)} - ours,
            foreign=foreign,
        )
        name = f"{config.robot.name}, {bus.name}" if len(config.buses) > 1 else config.robot.name
        console.print(_table(name, load))
        console.print(f"sum {100 * load.total:.1f} %, allowed {100 * MAX_LOAD:.0f} %")
        loads.append(load.total)
    sys.exit(OVER_BUDGET if max(loads) > MAX_LOAD else 0)


def _on_bus(config: RobotConfig, bus: CanConfig) -> tuple[list[Cyclic], set[str]]:
    """Return the frames of bought drives on a bus, and our own nodes on it by their DBC names."""
    from robotctl.app.processes.robot import node_parameters  # noqa: PLC0415
    from robotctl.drivers.can.bus_load import DRIVE  # noqa: PLC0415
    from robotctl.drivers.can.nodes.registry import wanted_nodes  # noqa: PLC0415

    frames: list[Cyclic] = []
    nodes = wanted_nodes(node_parameters(config))
    ours = {each.name.upper() for each in nodes if config.bus_of(each.name) is bus}
    for motor in config.motors:
        if config.bus_of(motor.name) is bus:
            traffic = motor.traffic(config.safety, config.runtime.rate_hz)
            if traffic is None:
                ours.add(DRIVE)
            else:
                frames += traffic
    return frames, ours


@app.command("scan")
@takes_options
def scan_bus(
    robot: Annotated[
        Path | None,
        typer.Option(
            parser=robot_file,
            metavar="NAME",
            help="Robot whose buses are scanned: a file, or a built-in one.",
        ),
    ] = None,
    interface: Annotated[
        Literal["socketcan", "simcan"], typer.Option(help="Kind of bus.")
    ] = "socketcan",
    channel: Annotated[str, typer.Option(help="Network device, or simulated bus.")] = "can0",
    bitrate: Annotated[int, typer.Option(help="Bit rate [bit/s].")] = 1_000_000,
    data_bitrate: Annotated[
        int, typer.Option(help="Data bit rate of CAN FD [bit/s]; 0: a classic bus.")
    ] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    overrides: Overrides = (),
) -> None:
    """Find the devices on a bus without moving any, and suggest tables for the robot's file.

    Status 0: all is well. 1: something must be mended, or nothing was found.
    """
    from robotctl.cli.can_scan import print_json, print_reports, scan_buses  # noqa: PLC0415
    from robotctl.config.robot_file import load_robot  # noqa: PLC0415
    from robotctl.drivers.can.config import CanConfig  # noqa: PLC0415
    from robotctl.drivers.can.scan_tables import WHEELS  # noqa: PLC0415

    wheels: tuple[str, ...] = WHEELS
    if robot is None:
        try:
            buses: tuple[CanConfig, ...] = (CanConfig(interface, channel, bitrate, data_bitrate),)
        except InvalidValue as error:
            raise ConfigError(f"--{error.key.replace('_', '-')}: {error.rule}") from None
    else:
        config = load_robot(robot, overrides)
        buses, wheels = config.buses, (*config.drive.wheel_names, *config.drive.joint_names)
    reports = scan_buses(buses)
    if json:
        print_json(reports)
    else:
        print_reports(plain_console(), reports, wheels)
    sys.exit(0 if all(report.is_good for _, report in reports) else TO_BE_MENDED)


def _table(name: str, load: BusLoad) -> Table:
    """Return the budget of a bus as a table."""
    bus = load.bus
    rates = f"{bus.bitrate}, data {bus.data_bitrate}" if bus.data_bitrate else f"{bus.bitrate}"
    table = Table(title=f"{name}: {rates} bit/s, worst-case stuffing")
    for heading in ("id", "frame", "period ms", "bits", "load %"):
        table.add_column(heading, justify="left" if heading == "frame" else "right")
    for row in load.rows:
        extended = row.arbitration_id & EXTENDED_FLAG
        plain = row.arbitration_id & (0x1FFF_FFFF if extended else 0x7FF)
        table.add_row(
            f"0x{plain:0{8 if extended else 3}X}",
            row.name,
            f"{row.period_ms:g}",
            f"{row.bits.nominal}+{row.bits.data}" if row.bits.data else str(row.bits.nominal),
            f"{100 * row.load:.2f}",
        )
    return table
