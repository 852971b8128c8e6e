"""Arguments that several subcommands share."""

from __future__ import annotations

from typing import Annotated

import typer

RobotName = Annotated[
    str, typer.Option("--robot", help="Robot file, or the name of one that comes along.")
]

TimeUnit = Annotated[
    str | None,
    typer.Option("--time-unit", help="Of the log's times: s, ms, us or ns; else its format's own."),
]

MaxRange = Annotated[
    float | None,
    typer.Option(
        "--max-range",
        metavar="M",
        help="Lidar ranges from here on are no echoes, else found out from the log.",
    ),
]

Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override one key, e.g. control.left.kp=2."),
]
