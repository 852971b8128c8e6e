"""Options of `robotctl slam`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Final

import typer

from robotctl.config.arguments import Sweep, TimeUnit
from robotctl.errors import ConfigError
from robotctl.estimation.slam.ekf_slam.bookkeeping import ASSOCIATIONS
from robotctl.estimation.slam.local_scans.registry import SCAN_SOURCES
from robotctl.toml_source import nearest

WORDS: Final = {
    "features": ("landmarks",),
    "solver": ("ekf", "graph", "submaps"),
    "association": ASSOCIATIONS,
}
"""Words that options of landmarks take."""


@dataclass(frozen=True, slots=True)
class SlamOptions:
    """A recorded drive, and what to make a map of: landmarks, or scans of `sensor`.

    Raises
    ------
    ConfigError
        If a word is unknown, or an option is one of the other kind of map.
    """

    log: Annotated[
        Path,
        typer.Option(
            help="MRCLAM folder, another log with sightings or scans, a graph, or NAME_DR.txt "
            "with ranges to beacons beside it."
        ),
    ]
    features: Annotated[str, typer.Option(help="What the map is made of: landmarks.")] = "landmarks"
    solver: Annotated[
        str,
        typer.Option(
            help="ekf: one Gaussian of robot and map. graph: then the best fit of all. submaps: "
            "local maps, joined, for logs that are graphs. Default: graph for these, else ekf."
        ),
    ] = ""
    association: Annotated[
        str,
        typer.Option(
            help="Which landmark is seen: names: as the log says; joint: what fits together best; "
            "nearest: each by itself."
        ),
    ] = "names"
    mrclam_robot: Annotated[
        int | None, typer.Option(min=1, help="Robot of an MRCLAM folder; default: 1.")
    ] = None
    sensor: Annotated[
        str | None,
        typer.Option(
            help=f"{', '.join(SCAN_SOURCES)}: match what it sees and draw a map, in place of "
            "landmarks."
        ),
    ] = None
    onto: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="Go on with this map of keyframes, made by the same --sensor.",
        ),
    ] = None
    images: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="With --sensor: the drive's pictures, named by time or listed, to know places by.",
        ),
    ] = None
    time_unit: TimeUnit = None
    sweep_s: Sweep = None

    def __post_init__(self) -> None:
        allowed = ", ".join(SCAN_SOURCES)
        if self.sensor is None:
            if self.images is not None:
                raise ConfigError(f"--images: needs --sensor {allowed}")
            if self.sweep_s is not None:
                raise ConfigError("--sweep: needs --sensor lidar")
            if self.onto is not None:
                raise ConfigError(f"--map: needs --sensor {allowed}")
        elif self.sensor not in SCAN_SOURCES:
            raise ConfigError(f"--sensor {self.sensor}: unknown; allowed is {allowed}")
        elif any(
            getattr(self, each.name) != each.default
            for each in fields(self)
            if each.name in (*WORDS, "mrclam_robot")
        ):
            raise ConfigError(
                f"--sensor {self.sensor}: --features, --solver, --association and --mrclam-robot "
                "are for landmarks, leave them"
            )
        for option, words in WORDS.items():
            word = getattr(self, option)
            if word not in words and (word or option != "solver"):
                raise ConfigError(
                    f"--{option} {word}: unknown; allowed are {', '.join(words)}"
                    f"{nearest(word, list(words))}"
                )
