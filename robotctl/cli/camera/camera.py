"""`robotctl camera`: calibrate a camera on the floor, check it, and measure with it."""

from __future__ import annotations

import typer

from robotctl.cli.camera import calibrate as camera_calibrate
from robotctl.cli.camera import check as camera_check
from robotctl.cli.camera import floor as camera_floor
from robotctl.cli.camera import pattern as camera_pattern
from robotctl.cli.camera import seeing as camera_seeing

app = typer.Typer(
    no_args_is_help=True, help="Calibrate a camera, and measure on the floor with it."
)
app.command("calibrate")(camera_calibrate.calibrate)
app.command("check")(camera_check.check)
app.command("floor")(camera_floor.floor)
app.command("obstacles")(camera_seeing.obstacles)
app.command("pattern")(camera_pattern.pattern)
app.command("ranges")(camera_seeing.ranges)


@app.callback()
def camera() -> None:
    """Calibrate a camera, and measure on the floor with it."""
