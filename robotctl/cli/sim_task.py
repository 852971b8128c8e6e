"""Task of a simulated robot, as the user gives it: where to drive, and what it knows."""

from __future__ import annotations

import atexit
import json
import shutil
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Final

import typer

from robotctl.config.arguments import place
from robotctl.errors import ConfigError
from robotctl.estimation.localisers import LocaliserName, localiser_kind
from robotctl.estimation.sensor_names import SENSORS

ERRAND: Final = "errand"
"""Mission of a robot that is told nothing; it has to find out where it is, too."""
PATROL, FLATS = "patrol", ("flat", "flat_lived_in")
"""The default mission, and the worlds with room for it."""
GOAL_WORLD: Final = "flat"
"""Where a goal lies unless the user says."""


@dataclass(frozen=True, slots=True)
class SimTask:
    """Where the simulated robot drives, and what it knows."""

    mission: Annotated[
        str,
        typer.Option(
            help="Mission file or name; default: errand; with --world a straight line, in the flat "
            "patrol."
        ),
    ] = ""
    goal: Annotated[
        str,
        typer.Option(
            metavar="X,Y[,DEG]|PLACE",
            help="Drive there, instead of a mission: by plan, or with --topological by places.",
        ),
    ] = ""
    topological: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="Map of places, of `robotctl topology build`, which the robot recognises.",
        ),
    ] = ""
    start: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,DEG]",
            help="Where the robot starts; `known`: where mission or world say, the default; "
            "`unknown`: there, and its localiser does not know it, the default for the errand.",
        ),
    ] = None
    localiser: Annotated[
        LocaliserName | None,
        typer.Option(
            help="Localisation method; default: as the robot's file says, mcl for the errand."
        ),
    ] = None
    map: Annotated[
        str,
        typer.Option(help="Map of the localiser: a world, or a ROS map.yaml; default: the world."),
    ] = ""
    sensors: Annotated[
        str,
        typer.Option(
            metavar="NAME,...",
            help=f"Sensors of the localiser: {', '.join(SENSORS)}; default: as the robot's file "
            "says.",
        ),
    ] = ""
    mapping: Annotated[
        bool, typer.Option("--mapping", help="Build a map of what the sensors see.")
    ] = False
    slam: Annotated[
        bool, typer.Option("--slam", help="Know no map: make one, and drive by that.")
    ] = False
    camera: Annotated[
        bool,
        typer.Option("--camera", help="Use the camera: ranges, obstacles, and their score."),
    ] = False

    def completed(self, world: str) -> SimTask:
        """Return the task in a world with what is not said.

        Raises
        ------
        ConfigError
            If options contradict each other.
        """
        if self.slam and (self.localiser is not None or self.map or self.start == "unknown"):
            raise ConfigError("--slam: not allowed with --localiser, --map and --start unknown")
        if self.goal and self.mission:
            raise ConfigError("--goal: not allowed with --mission, which says where to drive")
        if self.mission or self.goal or world or self.slam:
            return self
        method = self.localiser or "mcl"
        start = self.start or ("unknown" if localiser_kind(method).searches_map else None)
        return replace(self, mission=ERRAND, localiser=method, start=start)

    def pose(self) -> tuple[float, ...]:
        """Return where the robot starts [m, m, deg]; empty: as mission or world say."""
        if self.start in {None, "known", "unknown"}:
            return ()
        try:
            return place("--start", self.start or "")
        except ConfigError as error:
            raise ConfigError(f"{error}, or known, or unknown") from error

    def mission_file(self, world: str) -> Path:
        """Return the mission's file; where none is asked for, one that fits into the world."""
        from robotctl.app.simulation import room  # noqa: PLC0415 - help is quick
        from robotctl.config.robot_file import find_file  # noqa: PLC0415
        from robotctl.maps.world import find_world  # noqa: PLC0415

        if self.goal:
            return self._goal_mission(world)
        if self.mission or not world or find_world(world).stem in FLATS:
            return find_file(self.mission or PATROL, "missions")
        return _written("straight", room.straight_mission(find_world(world)))

    def _goal_mission(self, world: str) -> Path:
        """Return the file of a mission of one goal; without a world it is the flat."""
        from robotctl.app.simulation.room import goal_mission, place_mission  # noqa: PLC0415
        from robotctl.maps.world import find_world  # noqa: PLC0415

        room = find_world(world or GOAL_WORLD)
        if self.topological:
            return _written("goal", place_mission(room, self.pose(), self.goal))
        try:
            there = place("--goal", self.goal)
        except ConfigError as error:
            raise ConfigError(f"{error}; a place by name needs --topological FILE") from error
        return _written("goal", goal_mission(room, self.pose(), there))

    def settings(self) -> tuple[str, ...]:
        """Return the settings of camera and map of places."""
        from robotctl.config.robot_file import find_file  # noqa: PLC0415 - help is quick

        settings = ["camera.enabled=true"] if self.camera else []
        if self.topological:
            file = json.dumps(str(find_file(self.topological, "places")))
            settings.append(f"navigation.pilot.topology={file}")
        return tuple(settings)

    def localisation(self) -> tuple[str, ...]:
        """Return the settings of the localiser."""
        from robotctl.maps.world import find_world  # noqa: PLC0415 - help is quick

        settings = []
        if method := "slam" if self.slam else self.localiser:
            settings.append(f'localisation.method="{method}"')
        if self.start == "unknown":
            settings.append('localisation.start="unknown"')
        if self.map:
            settings.append(f'localisation.map="{find_world(self.map)}"')
        if self.sensors:
            names = ", ".join(f'"{name.strip()}"' for name in self.sensors.split(","))
            settings.append(f"localisation.sensors=[{names}]")
        if self.mapping or self.slam:
            settings.append("localisation.mapping=true")
        return tuple(settings)


def _written(name: str, text: str) -> Path:
    """Return a file of this run with a mission."""
    mission = own_folder() / f"{name}.toml"
    mission.write_text(text, encoding="utf-8")
    return mission


def own_folder() -> Path:
    """Return a new folder of this run, which goes with it."""
    folder = tempfile.mkdtemp(prefix="robotctl-sim-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
