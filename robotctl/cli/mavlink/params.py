"""`robotctl mavlink params`: parameters of a running robot."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.mavlink.link import DEFAULT, Key, Link, companion
from robotctl.words import counted

if TYPE_CHECKING:
    from robotctl.workbench.mavlink.parameters import ParameterClient

app = typer.Typer(help="Parameters of a running robot.", no_args_is_help=True)

REFUSED = 1
DIFFERENT = 1

Name = Annotated[str, typer.Argument(help="Of the parameter.")]
ParameterFile = Annotated[Path, typer.Argument(help="Lines of name and value.")]


@contextmanager
def _client(link: str, key: Path | None) -> Iterator[ParameterClient]:
    from robotctl.workbench.mavlink.parameters import ParameterClient  # noqa: PLC0415

    with companion(link, key) as robot:
        robot.find()
        yield ParameterClient(robot)


@app.command("list")
def list_all(
    pattern: Annotated[str, typer.Argument(help="Of names, with * and ?; default: all.")] = "",
    link: Link = DEFAULT,
    key: Key = None,
) -> None:
    """Print parameters and their values."""
    from robotctl.workbench.mavlink.parameters import matching  # noqa: PLC0415

    with _client(link, key) as client:
        for name, reading in matching(client.read_all(), pattern).items():
            print(f"{name:<16} {reading.text}")


@app.command()
def get(name: Name, link: Link = DEFAULT, key: Key = None) -> None:
    """Print the value of a parameter."""
    with _client(link, key) as client:
        print(client.get(name.upper()).text)


@app.command("set")
def set_one(
    name: Name,
    value: Annotated[float, typer.Argument(help="Its new value.")],
    link: Link = DEFAULT,
    key: Key = None,
) -> None:
    """Set a parameter, and print what the robot says of it."""
    with _client(link, key) as client:
        reading, said = client.set(name.upper(), value)
        print(said or f"{name.upper()}: {reading.text}")


@app.command()
def save(file: ParameterFile, link: Link = DEFAULT, key: Key = None) -> None:
    """Write all parameters to a file, as MAVProxy and Mission Planner read them."""
    from robotctl.workbench.mavlink import parameters  # noqa: PLC0415

    with _client(link, key) as client:
        readings = client.read_all()
    parameters.save(file, readings)
    print(f"{file}: {counted(len(readings), 'parameter')}")


@app.command()
def load(file: ParameterFile, link: Link = DEFAULT, key: Key = None) -> None:
    """Set what differs in a file. Status 1: the robot has not taken all."""
    from robotctl.workbench.mavlink import parameters  # noqa: PLC0415

    wanted = parameters.read(file)
    with _client(link, key) as client:
        waiting = [each.name for each in parameters.differences(client.read_all(), wanted)]
        refused: dict[str, str] = {}
        while waiting:  # some values are allowed only after others
            refused = {}
            for name in waiting:
                try:
                    reading, said = client.set(name, wanted[name])
                    print(said or f"{name}: {reading.text}")
                except parameters.ParameterRefusedError as error:
                    refused[name] = str(error)
            waiting = [*refused] if len(refused) < len(waiting) else []
    for why in refused.values():
        print(f"refused: {why}")
    if refused:
        raise typer.Exit(REFUSED)


@app.command()
def diff(file: ParameterFile, link: Link = DEFAULT, key: Key = None) -> None:
    """Print where the robot and a file differ. Status 1: they do."""
    from robotctl.workbench.mavlink import parameters  # noqa: PLC0415

    wanted = parameters.read(file)
    with _client(link, key) as client:
        found = parameters.differences(client.read_all(), wanted)
    for each in found:
        robot = "not there" if each.robot is None else each.robot
        print(f"{each.name:<16} robot {robot:<12} file {each.file}")
    if found:
        raise typer.Exit(DIFFERENT)
