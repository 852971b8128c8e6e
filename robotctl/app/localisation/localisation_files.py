"""The map and the places that a robot's file names: whether they load, and what has to go along."""

from __future__ import annotations

import os
from pathlib import Path

from robotctl.app.localisation.place_watch import find_places, load_place_watch
from robotctl.config.robot_file import MAPS, RobotConfig
from robotctl.errors import ConfigError
from robotctl.estimation.localisers import localiser_kind
from robotctl.maps.localisation_map import find_map, load_localisation_map, walls_of
from robotctl.maps.map_file import image_of
from robotctl.maps.topology_file import find_topology, load_places

_ANY_AREA_M2 = 1.0


def check_localisation(config: RobotConfig, robot: Path) -> None:
    """Load the map and the places that a robot's file names.

    Parameters
    ----------
    config, robot
        The robot and its file; relative names count from the file's folder.

    Raises
    ------
    ConfigError
        If one does not exist or is wrong; one line for each error.
    """
    settings, beside = config.localisation, robot.resolve().parent
    problems = []
    try:
        if settings.map:
            world_map = load_localisation_map(settings.map, beside)
            if localiser_kind(settings.method).needs_walls:
                walls_of(world_map, settings.map, settings.method)
    except (ConfigError, OSError) as error:
        problems.append(f"{robot}: localisation.map: {error}")
    try:
        load_place_watch(settings.places, beside, config.sonar, _ANY_AREA_M2)
    except (ConfigError, OSError) as error:
        problems.append(f"{robot}: localisation.places: {error}")
    try:
        load_places(config.navigation.pilot.topology, beside)
    except (ConfigError, OSError) as error:
        problems.append(f"{robot}: navigation.pilot.topology: {error}")
    if problems:
        raise ConfigError("\n".join(problems))


def files_beside(config: RobotConfig, robot: Path) -> dict[Path, bytes]:
    """Return the files that a robot's file names by relative paths, by those paths.

    Where the file goes elsewhere, they have to go along: map, image of a ROS map, places. What
    comes with robotctl and what an absolute path names is found anyway.

    Raises
    ------
    ConfigError
        If a file does not load, or a path leads out of the folder.
    """
    settings, beside = config.localisation, robot.resolve().parent
    check_localisation(config, robot)
    named: dict[Path, Path] = {}
    if settings.map:
        file, name = find_map(settings.map, beside), Path(settings.map)
        name = name.with_name(file.name)  # it may be given without its suffix
        if not name.is_absolute() and file in {(beside / name).resolve(), name.resolve()}:
            named[name] = file
            if file.suffix.lower() in MAPS:
                image = image_of(file)
                named[name.parent / os.path.relpath(image, file.parent)] = image
    if settings.places and not Path(settings.places).is_absolute():
        named[Path(settings.places)] = find_places(settings.places, beside)
    places = config.navigation.pilot.topology
    if places and not Path(places).is_absolute():
        named[Path(places)] = find_topology(places, beside)
    found: dict[Path, bytes] = {}
    for name, file in named.items():
        inside = Path(os.path.normpath(name))
        if inside.parts[0] == "..":
            raise ConfigError(
                f"{robot}: {name} leads out of the folder of the robot's file; put it into that "
                "folder or below, or give an absolute path"
            )
        found[inside] = file.read_bytes()
    return found
