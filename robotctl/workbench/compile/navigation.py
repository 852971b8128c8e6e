"""All that navigates a robot: planners, controllers, localisers, guard and camera."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.app.localisation.localiser import sensed_robot
from robotctl.app.localisation.map_sensors import MapSensors
from robotctl.app.processes.floor_pipeline import GroundWatch
from robotctl.app.processes.navigator import equip, make_navigation
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import config_directory
from robotctl.estimation.localisers import LOCALISERS
from robotctl.estimation.sensor_names import SENSORS
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.model.world_map import WorldMap
from robotctl.planning.path.local.controllers import CONTROLLERS

CONFIGS: Final = config_directory()
"""Only what comes along: a file of the same name may lie in the working directory."""
FLAT: Final = str(CONFIGS / "worlds" / "flat.toml")
MAP: Final = f"localisation.map={json.dumps(FLAT)}"
CAMERA: Final = "camera.enabled=true"


def warm_up() -> None:
    """Make robots that turn and that steer ready to drive, with each part there is to choose."""
    for name, settings in _robots():
        options = StackOptions("compile", str(CONFIGS / f"{name}.toml"), settings)
        config = options.load()
        estimators = load_estimators(config, options)
        adapter = make_navigation(config, options)
        equip(adapter.navigator, config, options, estimators)
        if config.camera is not None and config.has_camera:
            GroundWatch(config.camera, config.ground_camera)
    _sense_by_grid()


def _robots() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield built-in robots with settings that between them choose every part."""
    every = f"localisation.sensors={json.dumps([*SENSORS])}"
    for name, kind in LOCALISERS.items():
        localiser = (f'localisation.method="{name}"', *([MAP] if kind.needs_map else []))
        yield "diff_drive", (*localiser, every, CAMERA, "localisation.mapping=true")
        yield "ackermann", localiser
    for controller in CONTROLLERS:
        yield "jackal", (f'navigation.pilot.controller="{controller}"',)


def _sense_by_grid() -> None:
    """Measure in a map of cells, as a ROS map is: beams that few particles agree with, too."""
    config = StackOptions("compile", str(CONFIGS / "diff_drive.toml"), (CAMERA,)).load()
    known = load_localisation_map(FLAT, Path())
    for measurement in MapSensors(WorldMap(known.grid, None), sensed_robot(config)).rehearsal():
        measurement(np.zeros((1, 3)))
