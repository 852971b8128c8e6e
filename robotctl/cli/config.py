"""`robotctl config`: check a robot's file, show it whole, list every key."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, robot_file
from robotctl.config_values import descriptions
from robotctl.words import counted

Robot = Annotated[
    Path, typer.Argument(parser=robot_file, help="Robot file, or the name of a built-in one.")
]

app = typer.Typer(help="Check and show robot configurations.", no_args_is_help=True)


@app.command()
@takes_options
def check(file: Robot, overrides: Overrides = ()) -> None:
    """Check a robot's file as a whole, its map and its places; status 2 if something is wrong.

    One line for each error.
    """
    from robotctl.app.simulation.simulator_files import simulated_robot  # noqa: PLC0415
    from robotctl.config.robot_file import load_robot  # noqa: PLC0415 - pydantic

    config = load_robot(file, overrides)
    if config.simulation:
        simulated_robot(file, overrides)
    if config.localisation.map or config.localisation.places:
        # It loads numba.
        from robotctl.app.localisation.localisation_files import check_localisation  # noqa: PLC0415

        check_localisation(config, file)
    print(
        f"{file}: {config.robot.name}, {config.drive.kind}, "
        f"{counted(len(config.sonar), 'sonar')}, "
        f"{config.runtime.rate_hz} Hz: all keys are known and all values are allowed"
    )


@app.command()
@takes_options
def show(file: Robot = DEFAULT_ROBOT, overrides: Overrides = ()) -> None:
    """Print a robot's whole configuration as JSON, defaults and overrides included."""
    import msgspec  # noqa: PLC0415

    from robotctl.config.robot_file import load_robot  # noqa: PLC0415 - pydantic

    config = load_robot(file, overrides)
    print(msgspec.json.format(msgspec.json.encode(config)).decode())


@app.command()
def schema() -> None:
    """Print the JSON schema of a robot's file: every key, its type, its default and its meaning."""
    import pydantic  # noqa: PLC0415

    from robotctl.config.robot_file import RobotConfig  # noqa: PLC0415

    whole = pydantic.TypeAdapter(RobotConfig).json_schema()
    for table in (whole, *whole["$defs"].values()):
        text = table.get("description", "")
        for key, meaning in descriptions(text).items():
            table["properties"].get(key, {})["description"] = meaning
        if text:
            table["description"] = " ".join(text.partition("\n\n")[0].split())
    print(json.dumps(whole, indent=2))
