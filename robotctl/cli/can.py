"""`robotctl can`: the bus-load budget."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer
from rich.table import Table

from robotctl.cli.arguments import Overrides, RobotName
from robotctl.cli.console import plain_console
from robotctl.messages.ports import EXTENDED_FLAG

if TYPE_CHECKING:
    from robotctl.drivers.can.bus_load import BusLoad

app = typer.Typer(no_args_is_help=True)

OVER_BUDGET = 1


@app.callback()  # without one, a single subcommand would be the command itself
def can() -> None:
    """Print the load of the CAN bus."""


@app.command("budget")
def show_budget(robot: RobotName = "diff_drive", overrides: Overrides = None) -> None:
    """Print the worst-case load of each cyclic frame; status 1 where a bus is over 50 %."""
    from robotctl.config.robot_file import config_directory, find_file, load_robot  # noqa: PLC0415
    from robotctl.drivers.can.bus_load import MAX_LOAD, budget  # noqa: PLC0415
    from robotctl.drivers.can.dbc import load_dbc  # noqa: PLC0415
    from robotctl.drivers.can.nodes.registry import CAN_NODES  # noqa: PLC0415

    config = load_robot(find_file(robot), overrides or ())
    dbc = load_dbc(config_directory() / "robot.dbc")
    console = plain_console()
    nodes = [*(motor.name for motor in config.motors), *(each.name for each in CAN_NODES)]
    loads = []
    for bus in config.buses:
        elsewhere = {each.upper() for each in nodes if config.bus_of(each) is not bus}
        load = budget(
            dbc,
            config.runtime.rate_hz,
            bus,
            sonars=len(config.sonar),
            steered=bool(config.drive.joint_names),
            imu=config.imu.enabled,
            elsewhere=elsewhere,
        )
        name = f"{config.robot.name}, {bus.name}" if len(config.buses) > 1 else config.robot.name
        console.print(_table(name, load))
        console.print(f"sum {100 * load.total:.1f} %, allowed {100 * MAX_LOAD:.0f} %")
        loads.append(load.total)
    sys.exit(OVER_BUDGET if max(loads) > MAX_LOAD else 0)


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
