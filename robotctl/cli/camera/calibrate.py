"""`robotctl camera calibrate`: lens and mount, how good they are, and the patch."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import PatchFile
from robotctl.cli.console import plain_console
from robotctl.cli.files import advise_keeping, check_files, give_patch, write_file
from robotctl.cli.options import takes_options
from robotctl.errors import CalibrationError, ConfigError
from robotctl.workbench.camera.options import CameraCalibrateOptions

if TYPE_CHECKING:
    from robotctl.workbench.camera.calibrate import CameraCalibrateResult

ABORTED = 1


@takes_options
def calibrate(
    options: CameraCalibrateOptions,
    show: Annotated[
        Path | None, typer.Option(help="Draw points and a grid of the floor into the picture.")
    ] = None,
    out: PatchFile = None,
) -> None:
    """Find lens and mount of a camera, say how good they are, and which markers would help.

    Status 0: found. 1: the pictures or points do not determine it. 2: bad input.
    """
    from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415 - numba
    from robotctl.workbench.camera.calibrate import calibrate_camera  # noqa: PLC0415
    from robotctl.workbench.camera.pictures import check_suffix  # noqa: PLC0415

    check_files(show, out)
    if show is not None:
        check_suffix(show)
        if options.floor is None:
            raise ConfigError("--show needs --floor PICTURE to draw into")
    progress = plain_console(stderr=True)
    if (options.floor or options.points) and cache_is_cold():
        progress.print(f"{COMPILING} …", soft_wrap=True)
    try:
        result = calibrate_camera(options, lambda line: progress.print(f"{line} …"))
    except CalibrationError as error:
        progress.print(f"robotctl: {error}", soft_wrap=True)
        sys.exit(ABORTED)
    _tell(result)
    if show is not None:
        _draw(result, show)
    give_patch(_patch(result), out)
    _advise(result)


def _tell(result: CameraCalibrateResult) -> None:
    """Print tables and notes."""
    from robotctl.cli.camera.view import (  # noqa: PLC0415 - it loads numba
        advice_lines,
        expected_table,
        fit_lines,
        lens_lines,
        points_table,
        values_table,
    )

    console = plain_console()
    console.print(values_table(result))
    lines = [] if result.lens is None else lens_lines(result.lens)
    lines += fit_lines(result)
    table = points_table(result)
    if table is not None:
        console.print(table)
    if result.expected:
        console.print(expected_table(result.expected, result.options.noise.sigma_px))
    for line in (*lines, *advice_lines(result), *result.notes):
        console.print(line, soft_wrap=True)


def _draw(result: CameraCalibrateResult, show: Path) -> None:
    """Draw what was found into the picture of the floor."""
    from robotctl.estimation.camera.calibration.overlay import (  # noqa: PLC0415
        draw_correspondences,
        draw_floor_grid,
    )
    from robotctl.workbench.camera.pictures import write_picture  # noqa: PLC0415

    fit, picture = result.fit, result.picture
    if fit is None or picture is None:
        return
    draw_floor_grid(picture, fit.camera)
    predicted = fit.camera.project_ground(result.points.ground)
    draw_correspondences(picture, result.points.pixels, predicted, fit.agree)
    write_file(show, lambda file: write_picture(file, picture))
    print(f"drawn: {show}")


def _patch(result: CameraCalibrateResult) -> str:
    from robotctl.workbench.camera.patch import patch_text  # noqa: PLC0415

    return patch_text(result)


def _advise(result: CameraCalibrateResult) -> None:
    """Say how to use the patch."""
    from robotctl.workbench.camera.patch import patch_values  # noqa: PLC0415

    robot, tables = result.options.robot, patch_values(result)
    if result.config.camera is None and len(tables) < 2:
        print(
            f"{robot} has no table [camera] yet, and needs both, intrinsics and mount: give --lens "
            "and --floor or --points together, or --lens-unknown."
        )
        return
    advise_keeping(robot, tables)
