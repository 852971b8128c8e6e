"""Objects that navigate a robot, from its configuration."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from robotctl import toml_source
from robotctl.app.compile_progress import compile_progress
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.fence_keeper import FenceKeeper
from robotctl.core.navigation_adapter import COMMAND_LIFE_PERIODS, NavigationAdapter
from robotctl.errors import ConfigError, InvalidValue
from robotctl.maps.mask_file import load_masks
from robotctl.maps.topology_file import load_places
from robotctl.messages.plans import KnownPlace
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.planning.behave.behaviours.kind import UNHURRIED, Abilities, Pace, Pilot
from robotctl.planning.behave.mission.mission_file import Mission, mission_rules
from robotctl.planning.guard.sonars import sonar_directions
from robotctl.planning.guard.warm_up import warm_up as warm_up_guard
from robotctl.planning.map.topological.graph import TopologicalMap
from robotctl.planning.navigator import Navigator

if TYPE_CHECKING:
    from robotctl.app.localisation.estimators import Estimators


def load_mission(path: Path) -> Mission:
    """Read a mission file.

    Raises
    ------
    ConfigError
        With one line for each error.
    """
    return toml_source.load(path, Mission, rules=mission_rules)


def abilities(config: RobotConfig, robot: Path) -> Abilities:
    """Return what mission items may ask of a robot, whose file is `robot`.

    Raises
    ------
    ConfigError
        If the file of its places is wrong.
    """
    camera = config.camera
    sees_markers = camera is not None and camera.enabled and camera.markers is not None
    sides = sonar_directions(config.sonar)
    places = _places(config, robot)
    names = () if places is None else tuple(each.name for each in places.places)
    guard, body = config.navigation.guard, config.footprint
    return Abilities(config.drive, sides, guard, body, sees_markers, names)


def _places(config: RobotConfig, robot: Path) -> TopologicalMap | None:
    return load_places(config.navigation.pilot.topology, robot.resolve().parent)


def make_navigation(
    config: RobotConfig, options: StackOptions, pace: Pace = UNHURRIED
) -> NavigationAdapter:
    """Return the navigator of a robot with its message adapter, its steps at a pace.

    Raises
    ------
    ConfigError, MissionError
        If the mission's file is wrong, or the robot cannot drive it.
    """
    mission = load_mission(Path(options.mission)) if options.mission else None
    topology = _places(config, Path(options.robot))
    able = abilities(config, Path(options.robot))
    navigator = Navigator(
        config.navigation,
        config.drive,
        config.limits,
        config.sonar,
        mission,
        SE2(options.x_m, options.y_m, options.theta_rad),
        lidars=len(config.lidars),
        sees_markers=able.sees_markers,
        places=able.places,
        body=config.body,
        pace=pace,
    )
    mavlink, period_ns = config.mavlink, round(1e9 / config.navigation.rate_hz)
    holds_on_loss = mavlink.hold_on_gcs_loss and not mavlink.hold_without_gcs
    return NavigationAdapter(
        navigator,
        config.navigation,
        FenceKeeper(
            config.limits,
            config.footprint,
            period_ns,
            COMMAND_LIFE_PERIODS * period_ns,
            steered=config.drive.min_turning_radius_m > 0.0,
        ),
        has_localiser=config.localisation.method != "none",
        camera_rate_hz=_camera_rate_hz(config),
        needs_station=mavlink.hold_without_gcs,
        station_timeout_s=mavlink.gcs_timeout_s if holds_on_loss else math.inf,
        mission_content=Path(options.mission).read_bytes() if options.mission else b"",
        places=_known_places(topology),
        links=_links(topology),
    )


def _known_places(topology: TopologicalMap | None) -> tuple[KnownPlace, ...]:
    """Return the places whose coordinates are known."""
    places = () if topology is None else topology.places
    return tuple(
        KnownPlace(each.name, each.x_m, each.y_m) for each in places if math.isfinite(each.x_m)
    )


def _links(topology: TopologicalMap | None) -> tuple[tuple[int, int], ...]:
    """Return the pairs of numbers of known places with a passage between them."""
    numbers = {each.name: number for number, each in enumerate(_known_places(topology))}
    passages = () if topology is None else topology.passages
    return tuple(
        (numbers[a], numbers[b])
        for each in passages
        for a, b in (each.between,)
        if a in numbers and b in numbers
    )


def _camera_rate_hz(config: RobotConfig) -> float:
    """Return the pictures a second of the camera that the guard counts on; 0: there is none."""
    return config.camera.rate_hz if config.camera is not None and config.has_camera else 0.0


def equip(
    navigator: Navigator,
    config: RobotConfig,
    options: StackOptions,
    estimators: Estimators | None,
    say: Callable[[str], None] = lambda _: None,
    *,
    plan_s: float = math.inf,
    pace: Pace = UNHURRIED,
) -> bool:
    """Give the navigator what it drives through the world by; return whether scans are of use.

    A pilot, which plans journeys, needs a map or a lidar, unless its mission drives by plan: then
    sonars have to do.

    Parameters
    ----------
    say
        Given what people should know while it compiles.
    plan_s
        The time that planning may take in a step [s].
    pace
        Told of the parts of its steps, and asked how much it may do in them.

    Raises
    ------
    ConfigError
        If the robot's file names a planner or controller that there is not.
    """
    with compile_progress(say):
        warm_up_guard()
    grid = None if estimators is None else estimators.world_map
    asked = navigator.auto.needs_pilot or bool(config.navigation.pilot.topology)
    if grid is not None or config.lidars or asked:
        navigator.take_pilot(_pilot(config, options, grid, say, plan_s, pace))
        return True
    return estimators is not None


def _pilot(
    config: RobotConfig,
    options: StackOptions,
    grid: GridMap | None,
    say: Callable[[str], None],
    plan_s: float,
    pace: Pace,
) -> Pilot:
    """Return what plans journeys, compiled and ready."""
    from robotctl.planning.behave.journey.pilot import MapPilot  # noqa: PLC0415

    try:
        pilot = MapPilot(
            config.navigation,
            config.drive,
            config.limits,
            config.footprint,
            config.sonar,
            grid,
            SE2(options.x_m, options.y_m, options.theta_rad),
            lidars=len(config.lidars),
            topology=_places(config, Path(options.robot)),
            masks=load_masks(config.navigation.pilot.mask, Path(options.robot).resolve().parent),
            budget=lambda: _time_left(plan_s),
            pace=pace,
        )
    except InvalidValue as error:
        raise ConfigError(f"{options.robot}: navigation.pilot.{error}") from error
    with compile_progress(say):
        pilot.warm_up()
    return pilot


def _time_left(plan_s: float) -> Callable[[], bool]:
    """Return what says whether a time from now on is not over."""
    end_s = time.perf_counter() + plan_s
    return lambda: time.perf_counter() < end_s
