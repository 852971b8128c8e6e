"""`robotctl camera pattern`: a chessboard or a marker to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robotctl.cli.files import check_files, write_file
from robotctl.cli.options import takes_options
from robotctl.errors import ConfigError
from robotctl.workbench.camera.options import BoardName, Family, Square, board_of


@takes_options
def pattern(
    out: Annotated[Path, typer.Option(help="Write it here: .png, which states its printed size.")],
    board: BoardName = "9x6",
    square_mm: Square = 25.0,
    marker: Annotated[
        int | None, typer.Option(min=0, help="Print a marker with this number instead of a board.")
    ] = None,
    family: Family = "apriltag_36h11",
    side_mm: Annotated[
        float, typer.Option(min=10.0, max=1000.0, help="Side of the marker's black square.")
    ] = 150.0,
) -> None:
    """Draw a chessboard, or a marker, to print at its true size."""
    from robotctl.estimation.camera.calibration.pattern import (  # noqa: PLC0415
        PX_PER_MM,
        draw_board,
        draw_marker,
    )
    from robotctl.workbench.camera.pictures import write_print  # noqa: PLC0415 - it loads OpenCV

    check_files(out)
    if out.suffix.lower() != ".png":
        raise ConfigError(f"{out}: the suffix must be .png")
    try:
        if marker is None:
            sheet = draw_board(board_of(board, square_mm))
        else:
            sheet = draw_marker(family, marker, 1e-3 * side_mm)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    write_file(out, lambda file: write_print(file, sheet, PX_PER_MM))
    height_mm, width_mm = (side / PX_PER_MM for side in sheet.shape)
    print(
        f"{out}: {width_mm:g} x {height_mm:g} mm. Print it at 100 %, not fitted to the page, and "
        "measure it: the measured size counts."
    )
