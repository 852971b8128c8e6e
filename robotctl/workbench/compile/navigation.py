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
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.rectangle import Rectangle
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.world_map import WorldMap
from robotctl.planning.guard.change_of_course import Agility, is_free
from robotctl.planning.guard.course import Course
from robotctl.planning.guard.echo_memory import EchoMemory
from robotctl.planning.guard.swept_body import free_way
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
    _guard()


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


def _guard() -> None:
    """Keep an echo, and look how far, and on which course, a body may go before it."""
    ahead, body = SonarMount("ahead", 0.2, 0.0, 0.0), Rectangle(-0.2, 0.2, 0.2)
    memory = EchoMemory((ahead,), body)
    for now_ns in range(3):
        points = memory.hear(SE2(), (0.5,), now_ns)
    free_way(body, points, 0.1, Course(1.0, 0.0, 0.0))
    agility = Agility((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), 0.2)
    is_free(body, points, Twist(0.1, 0.0), Twist(0.0, 0.0, 0.1), agility)
