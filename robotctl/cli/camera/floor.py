"""`robotctl camera floor`: a picture of the floor from above, and pixels in metres."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.table import Table

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
from robotctl.config.robot_file import camera_of, load_robot
from robotctl.errors import ConfigError

if TYPE_CHECKING:
    from robotctl.estimation.camera.calibration.floor import FloorWindow


@takes_options
def floor(
    picture: Annotated[Path, typer.Argument(help="Picture by the robot's camera.")],
    robot: RobotFile = DEFAULT_ROBOT,
    out: Annotated[
        Path | None, typer.Option(help="Write the floor as seen from above here.")
    ] = None,
    pixels: Annotated[
        Path | None,
        typer.Option(help="CSV of pixels, columns u, v: print their places on the floor."),
    ] = None,
    points: Annotated[
        Path | None, typer.Option(help="Write those places here as CSV instead.")
    ] = None,
    near: Annotated[float, typer.Option(metavar="M", help="From which x.")] = 0.0,
    far: Annotated[float, typer.Option(metavar="M", help="To which x.")] = 3.0,
    side: Annotated[float, typer.Option(metavar="M", help="Extent to either side.")] = 1.5,
    resolution: Annotated[float, typer.Option(metavar="M", help="Size of a pixel.")] = 0.005,
    sigma_px: Annotated[
        float, typer.Option(min=0.0, help="Standard deviation of a pixel, for the intervals.")
    ] = 0.5,
    overrides: Overrides = (),
) -> None:
    """Show the floor of a picture from above in metres, and convert pixels to metres."""
    from robotctl.model.sensors.camera_geometry import CameraGeometry  # noqa: PLC0415
    from robotctl.workbench.camera.floor import floor_picture, floor_table  # noqa: PLC0415
    from robotctl.workbench.camera.pictures import (  # noqa: PLC0415
        check_suffix,
        read_picture_of,
        write_picture,
    )
    from robotctl.workbench.camera.points import PIXELS, read_columns, write_columns  # noqa: PLC0415

    if points is not None and pixels is None:
        raise ConfigError("--points needs --pixels FILE.csv with the columns u, v")
    if out is None and pixels is None:
        raise ConfigError("nothing to do: give --out FILE.png, --pixels FILE.csv or both")
    check_files(out, points)
    if out is not None:
        check_suffix(out)
    view = _window(near, far, side, resolution)
    config = camera_of(load_robot(robot, overrides), robot)
    camera = CameraGeometry.of(config)
    image = read_picture_of(picture, config.intrinsics)
    clicked = None if pixels is None else read_columns(pixels, PIXELS)
    if out is not None:
        above = floor_picture(image, camera, view, clicked)
        write_file(out, lambda file: write_picture(file, above))
        print(f"from above: {out}, x up and y left, {1.0 / resolution:g} pixels per metre")
    if clicked is None:
        return
    table = floor_table(camera, clicked, sigma_px)
    if points is None:
        _print(table)
        return
    heading = (*PIXELS, "x_m", "y_m", "sigma_x_m", "sigma_y_m")
    write_file(points, lambda file: write_columns(file, heading, table))
    print(f"points: {points}")


def _window(near_m: float, far_m: float, side_m: float, pixel_m: float) -> FloorWindow:
    """Return the part of the floor to draw; raises `ConfigError` if it is none."""
    from robotctl.estimation.camera.calibration.floor import FloorWindow  # noqa: PLC0415

    try:
        return FloorWindow(near_m, far_m, side_m, pixel_m)
    except ValueError as error:
        raise ConfigError(f"--near, --far, --side, --resolution: {error}") from error


def _print(table: NDArray[np.float64]) -> None:
    """Print each pixel and its place."""
    lines = Table(title="pixels on the floor of base", title_justify="left")
    for heading in ("u px", "v px", "x m", "y m", "σ x mm", "σ y mm"):
        lines.add_column(heading, justify="right")
    for u, v, x_m, y_m, sigma_x_m, sigma_y_m in table:
        if math.isnan(x_m):
            lines.add_row(f"{u:.1f}", f"{v:.1f}", "not on", "the floor", "", "")
        else:
            sigmas = (f"{1e3 * sigma:.1f}" for sigma in (sigma_x_m, sigma_y_m))
            lines.add_row(f"{u:.1f}", f"{v:.1f}", f"{x_m:.4f}", f"{y_m:.4f}", *sigmas)
    plain_console().print(lines)
