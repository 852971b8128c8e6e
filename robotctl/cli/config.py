"""`robotctl config`: check a robot's file, show it whole, list every key."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.options import takes_options
from robotctl.config.arguments import DEFAULT_ROBOT, Overrides, robot_file
from robotctl.config_values import descriptions
from robotctl.errors import ConfigError, InvalidValue
from robotctl.words import counted

if TYPE_CHECKING:
    from robotctl.mavlink.globe import Origin

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
def zones(
    file: Annotated[Path, typer.Argument(help="GeoJSON: polygons and lines.")],
    origin: Annotated[
        str, typer.Option(metavar="LAT,LON", help="Origin of the map, where files have degrees.")
    ] = "",
    metres: Annotated[
        bool, typer.Option("--metres", help="Coordinates are those of the map.")
    ] = False,
    mission: Annotated[bool, typer.Option("--mission", help="For a mission's file.")] = False,
) -> None:
    """Print the zones of a GeoJSON file as they stand in a robot's file, or in a mission's.

    Properties: `name`; `speed_m_s`, the limit inside, by default 0: the robot keeps out; of
    lines `width_m`, by default 0.1.
    """
    from robotctl.workbench.planning import geojson  # noqa: PLC0415 - the map's rooms

    if metres == bool(origin):
        raise ConfigError(f"{file}: one of --origin LAT,LON and --metres must say what it measures")
    to_world = geojson.in_metres if metres else geojson.on_globe(_origin(origin))
    found = geojson.load_zones(file, to_world)
    print(geojson.as_toml(found, "zone" if mission else "navigation.pilot.zone"), end="")


def _origin(text: str) -> Origin:
    """Return the origin of --origin; raises ConfigError if it is none."""
    from robotctl.mavlink.globe import Origin  # noqa: PLC0415

    try:
        latitude_deg, longitude_deg = map(float, text.split(","))
        return Origin(latitude_deg, longitude_deg)
    except InvalidValue as error:
        raise ConfigError(f"--origin {text}: {error}") from error
    except ValueError:
        raise ConfigError(f"--origin {text}: two numbers are needed, such as 48.1,11.5") from None


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
