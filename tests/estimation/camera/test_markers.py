"""Markers in pictures: drawn here by OpenCV's projection, and by the simulated camera."""

import math
from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from firmware_sim.camera.camera import Camera
from firmware_sim.config.config import load_robot as load_simulated
from firmware_sim.world.shapes import Marker
from firmware_sim.world.world import load_world
from robotctl.config.robot_file import config_directory, find_file, load_robot
from robotctl.estimation.camera.calibration.pattern import MARKERS
from robotctl.estimation.camera.markers import MarkerDetector
from robotctl.model.geometry.angles import wrap_angle
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.camera import MarkerConfig, MarkerFamily
from robotctl.model.sensors.camera_geometry import CameraGeometry

GEOMETRY = CameraGeometry.of(load_robot(find_file("diff_drive")).camera)
SIDE_M = 0.12
DETECTOR = MarkerDetector(GEOMETRY, MarkerConfig(SIDE_M))


def projected(number, x_m, y_m, z_m, into_rad):
    """Return a picture of an upright marker in `base`: its corners where the lens puts them."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    paper = np.pad(cv2.aruco.generateImageMarker(dictionary, number, 240), 40, constant_values=255)
    half_m = 0.5 * SIDE_M * 320 / 240
    right = np.array([math.sin(into_rad), -math.cos(into_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    middle = np.array([x_m, y_m, z_m])
    corners = [
        middle + half_m * (a * right + b * up) for a, b in ((-1, 1), (1, 1), (1, -1), (-1, -1))
    ]
    pixels = GEOMETRY.project(np.array(corners)).astype(np.float32)
    flat = np.array([(0, 0), (319, 0), (319, 319), (0, 319)], np.float32)
    turn = cv2.getPerspectiveTransform(flat, pixels)
    grey = cv2.warpPerspective(paper, turn, (640, 480), flags=cv2.INTER_AREA, borderValue=180)
    return np.repeat(cv2.GaussianBlur(grey, (3, 3), 0.6)[:, :, None], 3, axis=2)


@pytest.mark.parametrize("into_deg", [0.0, 20.0, -35.0])
@pytest.mark.parametrize("at", [(0.6, 0.0), (0.9, 0.15), (1.3, -0.2)])
def test_place_and_direction_are_those_of_the_projection(at, into_deg):
    (seen,) = DETECTOR.detect(projected(7, *at, 0.2, math.radians(into_deg)))
    assert seen.number == 7
    assert math.dist((seen.x_m, seen.y_m), at) < 0.03 * math.hypot(*at)
    assert abs(math.degrees(wrap_angle(seen.theta_rad - math.radians(into_deg)))) < 6.0


def test_a_picture_without_markers_has_none():
    assert DETECTOR.detect(np.full((480, 640, 3), 128, np.uint8)) == ()


def test_the_families_of_a_robots_file_are_those_that_can_be_printed():
    assert set(get_args(MarkerFamily)) == set(MARKERS)


@pytest.mark.timeout(400)  # the first picture compiles
@pytest.mark.parametrize("pose", [SE2(3.9, 1.0, 0.0), SE2(3.6, 1.3, -0.4), SE2(4.2, 0.85, 0.2)])
def test_the_simulated_camera_shows_a_marker_where_the_world_has_it(pose):
    world = load_world(config_directory() / "worlds" / "flat.toml")
    marker = Marker((4.93, 1.0), 3, heading_deg=180.0, side_m=SIDE_M)
    camera = Camera(
        load_simulated(Path(find_file("diff_drive"))), replace(world, markers=(marker,)), seed=1
    )
    view = camera.look(pose.x_m, pose.y_m, pose.theta_rad)
    (seen,) = DETECTOR.detect(view.picture)
    there = pose @ SE2(seen.x_m, seen.y_m, seen.theta_rad)
    assert seen.number == 3
    assert math.dist((there.x_m, there.y_m), marker.at) < 0.03
    assert abs(math.degrees(wrap_angle(there.theta_rad))) < 6.0
