"""Options of `robotctl map`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from robotctl.config.arguments import MaxRange, Sweep, TimeUnit


@dataclass(frozen=True, slots=True)
class MapOptions:
    """Which scans of a log to map, and where to."""

    log: Annotated[
        Path, typer.Option(help="CARMEN log, LEGO folder, ROS bag or recording of robotctl.")
    ]
    prefix: Annotated[
        Path, typer.Option("--out", metavar="PREFIX", help="Write PREFIX.yaml and PREFIX.pgm.")
    ]
    scans: Annotated[
        str, typer.Option(help="all, or every second one: even or odd, counted from 0.")
    ] = "all"
    resolution_m: Annotated[float, typer.Option("--resolution", metavar="M", help="Cell size.")] = (
        0.05
    )
    max_range_m: MaxRange = None
    sweep_s: Sweep = None
    time_unit: TimeUnit = None
