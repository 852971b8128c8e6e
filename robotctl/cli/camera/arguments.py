"""Arguments that the subcommands of `robotctl camera` share, and what they mean."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.errors import ConfigError
from robotctl.model.geometry.se2 import SE2
from robotctl.toml_source import nearest

if TYPE_CHECKING:
    from robotctl.estimation.camera.calibration.homography import PointNoise
    from robotctl.estimation.camera.calibration.pattern import Board

BoardName = Annotated[
    str, typer.Option("--board", metavar="9x6", help="Inner corners of the chessboard.")
]
Square = Annotated[
    float, typer.Option("--square-mm", metavar="MM", help="Side of its squares, measured.")
]
Family = Annotated[
    str, typer.Option("--family", help="Marker family: 4x4_50 and others, apriltag_36h11.")
]
SigmaPx = Annotated[float, typer.Option("--sigma-px", help="Standard deviation of a pixel.")]
SigmaMm = Annotated[
    float,
    typer.Option("--sigma-mm", help="Standard deviation of a place on the floor, in x and in y."),
]


def board_of(name: str, square_mm: float) -> Board:
    """Return the board; raises ConfigError if invalid."""
    from robotctl.estimation.camera.calibration.pattern import Board  # noqa: PLC0415 - it loads OpenCV

    match = re.fullmatch(r"(\d+)x(\d+)", name.strip().lower())
    if match is None:
        raise ConfigError(f"--board {name}: not of the form 9x6, inner corners across and along")
    try:
        return Board(int(match[1]), int(match[2]), 1e-3 * square_mm)
    except ValueError as error:
        raise ConfigError(f"--board {name} --square-mm {square_mm:g}: {error}") from error


def family_of(name: str) -> str:
    """Return the family of markers; raises ConfigError if unknown."""
    from robotctl.estimation.camera.calibration.pattern import MARKERS  # noqa: PLC0415 - it loads OpenCV

    if name not in MARKERS:
        raise ConfigError(f"--family {name}: unknown{nearest(name, tuple(MARKERS))}")
    return name


def noise_of(sigma_px: float, sigma_mm: float) -> PointNoise:
    """Return the noise of points; raises ConfigError if it is out of its range."""
    from robotctl.estimation.camera.calibration.homography import PointNoise  # noqa: PLC0415 - numba

    try:
        return PointNoise(sigma_px, 1e-3 * sigma_mm)
    except ValueError as error:
        raise ConfigError(f"--sigma-px {sigma_px:g} --sigma-mm {sigma_mm:g}: {error}") from error


def place_of(text: str | None) -> SE2 | None:
    """Return `X,Y` or `X,Y,HEADING` (m, m, deg); raises ConfigError if it is not that."""
    if text is None:
        return None
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"--at {text}: not of the form X,Y or X,Y,HEADING, in metres and degrees")
    x_m, y_m, heading_deg = (*numbers, 0.0)[:3]
    return SE2(x_m, y_m, math.radians(heading_deg))


def pictures_of(names: list[str], option: str = "--lens ") -> tuple[Path, ...]:
    """Return picture files: all of a folder, those matching a pattern, otherwise the file itself.

    `option` is what the user wrote before the name, for messages.

    Raises
    ------
    ConfigError
        If a name fits nothing.
    """
    from robotctl.workbench.camera.pictures import SUFFIXES  # noqa: PLC0415 - it loads OpenCV

    files: list[Path] = []
    for name in names:
        path = Path(name)
        if path.is_dir():
            found = [each for each in path.iterdir() if each.suffix.lower() in SUFFIXES]
        elif "*" in path.name or "?" in path.name:
            found = list(path.parent.glob(path.name))
        else:
            found = [path]
        if not found:
            raise ConfigError(f"{option}{name}: no pictures found")
        files += sorted(found)
    return tuple(dict.fromkeys(files))
