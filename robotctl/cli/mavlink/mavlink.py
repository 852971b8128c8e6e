"""`robotctl mavlink`: keys for message signing, parameters, and what comes over a link."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from robotctl.cli.mavlink import monitor, params

app = typer.Typer(help="MAVLink: parameters of a robot, its messages, keys.", no_args_is_help=True)


app.add_typer(params.app, name="params")
app.command()(monitor.monitor)


@app.command()
def keygen(
    file: Annotated[Path, typer.Argument(help="The new file; one that exists is not replaced.")],
) -> None:
    """Write a key for message signing to a file that only its owner may read, and print it.

    It is a pass phrase, as ground stations ask for; name the file in mavlink.signing_key.
    """
    from robotctl.app.signing_files import write_new_key  # noqa: PLC0415

    print(write_new_key(file))
