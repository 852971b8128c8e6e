"""`robotctl record`: the flight recorder on request."""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Annotated

import typer

from robotctl.runtime.flight_ring import dump as dump_ring
from robotctl.runtime.recorder import RecordError
from robotctl.runtime.ring_file import crashed
from robotctl.runtime.topics import ring_path

app = typer.Typer(help="The flight recorder and the logs.", no_args_is_help=True)


@app.command()
def dump(
    file: Annotated[
        Path | None, typer.Argument(help="Where to; default: flight-TIME.rec here.")
    ] = None,
    instance: Annotated[
        str, typer.Option(help="Which robot; default: the only one there is.")
    ] = "",
) -> None:
    """Write the last minute of the control loop to a record, for `robotctl replay`.

    Works while the robot drives, which it does not notice, and after its processes were killed.
    """
    ring = find_ring(instance)
    target = file or Path(f"flight-{dt.datetime.now(dt.UTC):%Y%m%dT%H%M%S}Z.rec")
    try:
        dump_ring(ring, target)
    except OSError as error:
        raise RecordError(f"{target}: cannot be written: {error.strerror}") from error
    print(f"{ring} written to {target}, {target.stat().st_size} bytes")


@app.command()
def recover(
    file: Annotated[Path, typer.Argument(help="robot-*.mcap that was cut by a kill.")],
) -> None:
    """Complete an MCAP log that was not closed, in place; the recorder does so when it starts."""
    from robotctl.telemetry.mcap_log import recover as recover_log  # noqa: PLC0415 - loads zstd

    try:
        count = recover_log(file)
    except OSError as error:
        raise RecordError(f"{file}: cannot be recovered: {error.strerror}") from error
    print(f"{file}: complete, {count} messages")


def find_ring(instance: str) -> Path:
    """Return the ring of an instance, or the only one there is.

    Raises
    ------
    RecordError
        If there is none, or more than one to choose from.
    """
    if instance:
        path = ring_path(instance)
        return path if path.exists() or not crashed(path).exists() else crashed(path)
    folder = ring_path("robot").parent
    rings = sorted((*folder.glob("*.ring"), *folder.glob("*.ring.crashed")))
    if len(rings) == 1:
        return rings[0]
    if not rings:
        raise RecordError(f"{folder}: no flight recorder is there: no robot runs, nor has crashed")
    names = ", ".join(path.name.rpartition("-")[0] for path in rings)
    raise RecordError(f"{folder}: which robot? --instance is one of: {names}")
