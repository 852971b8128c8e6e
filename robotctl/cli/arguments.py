"""Arguments that several subcommands share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from robotctl.errors import ConfigError

PatchFile = Annotated[
    Path | None, typer.Option(help="Write the configuration patch here; default: print it.")
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
