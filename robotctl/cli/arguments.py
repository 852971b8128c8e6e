"""Arguments that several subcommands share."""

from __future__ import annotations

from typing import Annotated

import typer

RobotName = Annotated[
    str, typer.Option("--robot", help="Robot file, or the name of one that comes along.")
]

Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override one key, e.g. control.left.kp=2."),
]
