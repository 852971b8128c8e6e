"""`robotctl camera calibrate`: lens and mount, how good they are, and the patch."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.arguments import Overrides, RobotName
from robotctl.cli.camera.arguments import (
    BoardName,
    Family,
    SigmaMm,
    SigmaPx,
    Square,
    board_of,
    family_of,
    noise_of,
    pictures_of,
    place_of,
)
from robotctl.cli.console import plain_console
from robotctl.cli.files import advise_keeping, check_files, give_patch, write_file
from robotctl.config.robot_file import find_file
from robotctl.errors import CalibrationError, ConfigError

if TYPE_CHECKING:
    from robotctl.workbench.camera.calibrate import CameraCalibrateResult

ABORTED = 1


def calibrate(
    robot: RobotName = "diff_drive",
    lens: Annotated[
        list[str] | None,
        typer.Option(
            help="Pictures of the board for the lens: file, folder, 'left*.jpg' or live:ROBOT."
        ),
    ] = None,
    lens_unknown: Annotated[
        bool, typer.Option("--lens-unknown", help="Find the focal length from the floor instead.")
    ] = False,
    board: BoardName = "9x6",
    square_mm: Square = 25.0,
    floor: Annotated[
        Path | None,
        typer.Option(help="Picture of the board or of markers on the floor, or live:ROBOT."),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,DEG", help="Middle of the board in base, and direction of its arrow."
        ),
    ] = None,
    markers: Annotated[
        Path | None, typer.Option(help="CSV of markers on the floor: id, x, y of their middle.")
    ] = None,
    family: Family = "apriltag_36h11",
    points: Annotated[
        Path | None, typer.Option(help="CSV of points clicked in a picture: u, v, x, y.")
    ] = None,
    sigma_px: SigmaPx = 0.5,
    sigma_mm: SigmaMm = 1.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search for outliers.")] = 1,
    show: Annotated[
        Path | None, typer.Option(help="Draw points and a grid of the floor into the picture.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Write the configuration patch here; default: print it.")
    ] = None,
    overrides: Overrides = None,
) -> None:
    """Find lens and mount of a camera, say how good they are, and which markers would help.

    Status 0: found. 1: the pictures or points do not determine it. 2: bad input.
    """
    from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415 - numba
    from robotctl.workbench.camera.calibrate import CameraCalibrateOptions, calibrate_camera  # noqa: PLC0415
    from robotctl.workbench.camera.pictures import check_suffix  # noqa: PLC0415

    check_files(show, out)
    if show is not None:
        check_suffix(show)
        if floor is None:
            raise ConfigError("--show needs --floor PICTURE to draw into")
    options = CameraCalibrateOptions(
        find_file(robot),
        tuple(overrides or ()),
        pictures_of(lens or []),
        lens_unknown,
        board_of(board, square_mm),
        floor,
        place_of(at),
        markers,
        family_of(family),
        points,
        noise_of(sigma_px, sigma_mm),
        seed,
    )
    progress = plain_console(stderr=True)
    if (floor or points) and cache_is_cold():
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
