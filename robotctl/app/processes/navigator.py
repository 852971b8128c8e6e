"""From a configuration to the objects that navigate a robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from robotctl import toml_source
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.navigation_adapter import NavigationAdapter
from robotctl.model.geometry.se2 import SE2
from robotctl.planning.behaviours.mission import Mission
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
