"""`robotctl can`: the bus-load budget."""

from __future__ import annotations

import sys

import typer
from rich.table import Table

from robotctl.cli.arguments import Overrides, RobotName
from robotctl.cli.console import plain_console

app = typer.Typer(help="The CAN bus.", no_args_is_help=True)

OVER_BUDGET = 1


@app.callback()
def can() -> None:
    """Keep `budget` a subcommand while it is the only one."""


@app.command("budget")
def show_budget(robot: RobotName = "diff_drive", overrides: Overrides = None) -> None:
    """Print the worst-case load of each cyclic frame; status 1 where the sum is over 50 %."""
    from robotctl.config.robot_file import config_directory, find_file, load_robot  # noqa: PLC0415
    from robotctl.drivers.can.bus_load import MAX_LOAD, budget  # noqa: PLC0415
    from robotctl.drivers.can.dbc import load_dbc  # noqa: PLC0415

    config = load_robot(find_file(robot), overrides or ())
    load = budget(
        load_dbc(config_directory() / "robot.dbc"),
        config.runtime.rate_hz,
        config.can.bitrate,
        sonars=len(config.sonar),
        steered=config.drive.steered,
        imu=config.imu.enabled,
    )
    table = Table(title=f"{config.robot.name}: {config.can.bitrate} bit/s, worst-case stuffing")
    for heading in ("id", "frame", "period ms", "bits", "load %"):
        table.add_column(heading, justify="left" if heading == "frame" else "right")
    for row in load.rows:
        table.add_row(
            f"0x{row.arbitration_id:03X}",
            row.name,
            f"{row.period_ms:g}",
            str(row.bits),
            f"{100 * row.load:.2f}",
        )
    console = plain_console()
    console.print(table)
    console.print(f"sum {100 * load.total:.1f} %, allowed {100 * MAX_LOAD:.0f} %")
    sys.exit(OVER_BUDGET if load.total > MAX_LOAD else 0)
