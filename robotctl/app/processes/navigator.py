"""From a configuration to the objects that navigate a robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from robotctl import toml_source
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.navigation_adapter import NavigationAdapter
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behaviours.explore import ExploreItem
from robotctl.planning.behaviours.goto import GotoItem
from robotctl.planning.behaviours.kind import Pilot
from robotctl.planning.behaviours.mission import Mission
from robotctl.planning.guard.body import body_outline
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
    return toml_source.load(path, Mission)


def make_navigation(config: RobotConfig, options: StackOptions) -> NavigationAdapter:
    """Return the navigator of a robot with its message adapter.

    Raises
    ------
    ConfigError, MissionError
        If the mission's file is wrong, or the robot cannot drive it.
    """
    mission = load_mission(Path(options.mission)) if options.mission else None
    navigator = Navigator(
        config.navigation,
        config.drive,
        config.limits,
        config.sonar,
        mission,
        SE2(options.x_m, options.y_m, options.theta_rad),
    )
    return NavigationAdapter(
        navigator,
        config.navigation,
        mission="" if mission is None else mission.name,
        has_localiser=config.localisation.method != "none",
        looks=config.camera is not None and config.camera.enabled,
        needs_station=config.mavlink.hold_without_gcs,
    )


def learn_paths(navigator: Navigator, config: RobotConfig, estimators: Estimators | None) -> None:
    """Let the navigator know the free paths through the map that the robot localises itself in."""
    if estimators is None or estimators.world_map is None:
        return
    # scipy and numba take a while to load.
    from robotctl.planning.global_planning.free_path import FreePaths  # noqa: PLC0415

    half_width_m = config.navigation.guard.half_width_m
    navigator.learn_paths(FreePaths(estimators.world_map, half_width_m))


def load_pilot(
    config: RobotConfig,
    options: StackOptions,
    estimators: Estimators | None,
    say: Callable[[str], None] = lambda _: None,
) -> Pilot | None:
    """Return what plans journeys, compiled and ready; None for a robot with nothing to plan by.

    That is one without a map and a lidar, unless its mission drives by plan: then sonars have to
    do. `say` is given what people should know while it compiles.

    Raises
    ------
    ConfigError
        If the robot's file names a planner or controller that there is not.
    """
    grid = None if estimators is None else estimators.world_map
    mission = load_mission(Path(options.mission)) if options.mission else None
    asked = mission is not None and any(
        isinstance(item, GotoItem | ExploreItem) for item in mission.item
    )
    if grid is None and config.lidar is None and not asked:
        return None
    # numba and scipy take a while to load.
    from robotctl.app.supervision.compile_progress import compile_progress  # noqa: PLC0415
    from robotctl.planning.journey.pilot import MapPilot  # noqa: PLC0415

    pilot = MapPilot(
        config.navigation,
        config.drive,
        config.limits,
        body_outline(config.navigation.guard, config.sonar),
        config.sonar,
        grid,
        SE2(options.x_m, options.y_m, options.theta_rad),
        has_lidar=config.lidar is not None,
    )
    with compile_progress(say):
        pilot.warm_up()
    return pilot
