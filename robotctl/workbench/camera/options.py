"""Options of `robotctl camera calibrate`, `check`, `ranges` and `obstacles`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, RobotFile
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


def _family(name: str) -> str:
    """Return the family of markers; raises ConfigError if unknown."""
    from robotctl.estimation.camera.calibration.pattern import MARKERS  # noqa: PLC0415 - it loads OpenCV

    if name not in MARKERS:
        raise ConfigError(f"--family {name}: unknown{nearest(name, tuple(MARKERS))}")
    return name


Family = Annotated[
    str,
    typer.Option(
        "--family",
        parser=_family,
        metavar="NAME",
        help="Marker family: 4x4_50 and others, apriltag_36h11.",
    ),
]


def _place(text: str) -> SE2:
    """Return `X,Y` or `X,Y,HEADING` (m, m, deg); raises ConfigError if it is not that."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"--at {text}: not of the form X,Y or X,Y,HEADING, in metres and degrees")
    x_m, y_m, heading_deg = (*numbers, 0.0)[:3]
    return SE2(x_m, y_m, math.radians(heading_deg))


@dataclass(frozen=True, slots=True, kw_only=True)
class PointOptions:
    """Points on the floor at known places, and how well they are known."""

    markers: Annotated[
        Path | None, typer.Option(help="CSV of markers on the floor: id, x, y of their middle.")
    ] = None
    family: Family = "apriltag_36h11"
    points: Annotated[
        Path | None, typer.Option(help="CSV of points clicked in a picture: u, v, x, y.")
    ] = None
    sigma_px: Annotated[float, typer.Option(help="Standard deviation of a pixel.")] = 0.5
    sigma_mm: Annotated[
        float, typer.Option(help="Standard deviation of a place on the floor, in x and in y.")
    ] = 1.0
    overrides: Overrides = ()

    @property
    def noise(self) -> PointNoise:
        """Noise of points; raises ConfigError if it is out of its range."""
        from robotctl.estimation.camera.calibration.homography import PointNoise  # noqa: PLC0415 - numba

        try:
            return PointNoise(self.sigma_px, 1e-3 * self.sigma_mm)
        except ValueError as error:
            raise ConfigError(
                f"--sigma-px {self.sigma_px:g} --sigma-mm {self.sigma_mm:g}: {error}"
            ) from error


@dataclass(frozen=True, slots=True)
class CameraCalibrateOptions(PointOptions):
    """Pictures and points to calibrate a camera from."""

    robot: RobotFile = DEFAULT_ROBOT
    lens: Annotated[
        tuple[str, ...],
        typer.Option(
            help="Pictures of the board for the lens: file, folder, 'left*.jpg' or live:ROBOT."
        ),
    ] = ()
    lens_unknown: Annotated[
        bool, typer.Option("--lens-unknown", help="Find the focal length from the floor instead.")
    ] = False
    board: BoardName = "9x6"
    square_mm: Square = 25.0
    floor: Annotated[
        Path | None,
        typer.Option(help="Picture of the board or of markers on the floor, or live:ROBOT."),
    ] = None
    at: Annotated[
        SE2 | None,
        typer.Option(
            parser=_place,
            metavar="X,Y,DEG",
            help="Middle of the board in base, and direction of its arrow.",
        ),
    ] = None
    seed: Annotated[int, typer.Option(min=0, help="Seed of the search for outliers.")] = 1

    def __post_init__(self) -> None:
        on_floor = self.at is not None or self.markers is not None
        if on_floor and self.floor is None:
            raise ConfigError("--at and --markers need --floor PICTURE, in which they are seen")
        if self.floor is not None and not on_floor:
            raise ConfigError(
                "--floor needs --at X,Y,HEADING, where the board lies, or --markers FILE.csv"
            )
        if self.lens and self.lens_unknown:
            raise ConfigError("--lens and --lens-unknown contradict each other")
        if not (self.lens or self.floor or self.points):
            raise ConfigError(
                "nothing to calibrate from: give --lens PICTURES, --floor PICTURE with --at or "
                "--markers, --points FILE.csv, or several of these; docs/camera.md says how"
            )

    @property
    def chessboard(self) -> Board:
        """The board of `lens` and of `floor`."""
        return board_of(self.board, self.square_mm)


@dataclass(frozen=True, slots=True)
class CheckOptions(PointOptions):
    """Picture and points to check a calibration against."""

    picture: Annotated[
        Path | None, typer.Argument(help="Picture of markers on the floor, by the robot's camera.")
    ] = None
    robot: RobotFile = DEFAULT_ROBOT

    def __post_init__(self) -> None:
        if (self.picture is None) != (self.markers is None):
            raise ConfigError("a picture and --markers FILE.csv belong together")
        if self.markers is None and self.points is None:
            raise ConfigError(
                "nothing to check against: give PICTURE with --markers FILE.csv, or --points "
                "FILE.csv, or both"
            )


@dataclass(frozen=True, slots=True)
class SeeingOptions:
    """Pictures of a robot's calibrated camera, and how to look at them."""

    pictures: Annotated[
        tuple[str, ...],
        typer.Argument(
            help="Pictures of the robot's camera: files, folders, or live:ROBOT for a running "
            "robot."
        ),
    ]
    robot: RobotFile = DEFAULT_ROBOT
    sequence: Annotated[
        bool,
        typer.Option(
            "--sequence",
            help="The pictures are consecutive: the floor is known from earlier ones.",
        ),
    ] = False
    overrides: Overrides = ()
