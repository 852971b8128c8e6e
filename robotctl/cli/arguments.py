"""Arguments that several subcommands share."""

from __future__ import annotations

import json
import math
from typing import Annotated

import typer

from robotctl.errors import ConfigError

RobotName = Annotated[
    str, typer.Option("--robot", help="Robot file, or the name of a built-in one.")
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

Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override one key, e.g. control.left.kp=2."),
]


Web = Annotated[
    str | None,
    typer.Option(
        "--web",
        metavar="HOST:PORT",
        help="Serve the web page there, such as 127.0.0.1:8080, or 0.0.0.0:8080 for a phone.",
    ),
]


def web_settings(address: str) -> tuple[str, ...]:
    """Return the settings of a web page at HOST:PORT, which the robot's file checks.

    None for an empty one.

    Raises
    ------
    ConfigError
        If there is no port.
    """
    if not address:
        return ()
    host, _, port = address.rpartition(":")
    if not host or not port.isascii() or not port.isdecimal():
        raise ConfigError(
            f"--web {address}: HOST:PORT is needed, such as 127.0.0.1:8080 or 0.0.0.0:8080"
        )
    host = json.dumps(host.removeprefix("[").removesuffix("]"))
    return "web.enabled=true", f"web.host={host}", f"web.port={int(port)}"


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


def refuse_unused(ctx: typer.Context, why: str, *parameters: str) -> None:
    """Refuse options that are given where they have no effect.

    Parameters
    ----------
    ctx
        Of the command, which knows what was given.
    why
        Why they have none, and what to do.
    parameters
        Names of the command's parameters.

    Raises
    ------
    ConfigError
        With the first of them that is given.
    """
    for each in ctx.command.params:
        source = ctx.get_parameter_source(each.name or "")
        if each.name in parameters and source is not None and source.name == "COMMANDLINE":
            raise ConfigError(f"{each.opts[0]}: has no effect {why}")
