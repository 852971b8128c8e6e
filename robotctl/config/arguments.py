"""Options of commands that several options classes share, as typer reads them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final

import typer

from robotctl.errors import ConfigError

DEFAULT_ROBOT: Final = Path("diff_drive")
"""Name of the robot of a command that is told none."""


def robot_file(name: str) -> Path:
    """Return the file of a robot, by its name or path; raises ConfigError if there is none."""
    from robotctl.config.robot_file import find_file  # noqa: PLC0415 - it loads numpy

    return find_file(name)


def mission_file(name: str) -> Path:
    """Return the file of a mission, by its name or path; raises ConfigError if there is none."""
    from robotctl.config.robot_file import find_file  # noqa: PLC0415 - it loads numpy

    return find_file(name, "missions")


RobotFile = Annotated[
    Path,
    typer.Option(
        "--robot",
        parser=robot_file,
        metavar="NAME",
        help="Robot file, or the name of a built-in one.",
    ),
]

Overrides = Annotated[
    tuple[str, ...],
    typer.Option("--set", metavar="KEY=VALUE", help="Override one key, e.g. control.left.kp=2."),
]

TimeUnit = Annotated[
    str | None,
    typer.Option(
        "--time-unit", help="Unit of the log's times: s, ms, us or ns; default: its format's."
    ),
]

MaxRange = Annotated[
    float | None,
    typer.Option(
        "--max-range",
        metavar="M",
        help="Lidar ranges from here on are no echoes; default: found from the log.",
    ),
]

Sweep = Annotated[
    float | None,
    typer.Option(
        "--sweep",
        metavar="S",
        help="Time from a lidar scan's first beam to its last, negative if it measures the last "
        "one first; 0: all at once; default: as the log says, mostly nothing.",
    ),
]


def place(option: str, text: str) -> tuple[float, ...]:
    """Return the numbers of a place: x, y and perhaps a heading.

    Raises
    ------
    ConfigError
        If it is none.
    """
    try:
        numbers = tuple(map(float, text.split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise ConfigError(
            f"{option} {text}: two or three numbers with commas are needed, such as 1.5,-2 or "
            "1.5,-2,90"
        )
    return numbers
