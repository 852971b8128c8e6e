"""Robots and rooms for the tests of the camera, and OpenCV's account of what it must see."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from firmware_sim.config.camera_parameters import CameraMount, Intrinsics
from firmware_sim.config.config import RobotConfig, load_robot
from firmware_sim.world.world import World, load_world

CONFIGS = Path(__file__).parents[3] / "configs"
DIFF = CONFIGS / "diff_drive.toml"
CLEAN = {
    "simulation.camera.read_noise": 0.0,
    "simulation.camera.shot_noise": 0.0,
    "simulation.camera.blur_px": 0.0,
    "simulation.camera.vignetting": 0.0,
}
SMALL = {
    "camera.intrinsics.width_px": 160,
    "camera.intrinsics.height_px": 120,
    "camera.intrinsics.fx_px": 114.0,
    "camera.intrinsics.fy_px": 114.0,
    "camera.intrinsics.cx_px": 79.5,
    "camera.intrinsics.cy_px": 59.5,
}
PINHOLE = {"camera.intrinsics.distortion": [0.0, 0.0, 0.0, 0.0, 0.0]}


def robot(*settings: dict[str, Any]) -> RobotConfig:
    """Return the default robot with some values replaced."""
    merged: dict[str, Any] = {}
    for each in settings:
        merged |= each
    return load_robot(DIFF, merged)


def room(folder: Path, text: str) -> World:
    """Return the world of a TOML, with a start at 0, 0 and bounds of 12 m."""
    path = folder / "room.toml"
    path.write_text(
        '[world]\nname = "room"\nbounds = [-6.0, -6.0, 6.0, 6.0]\nstart = {x_m = 0.0, y_m = 0.0}\n'
        + text,
        encoding="utf-8",
    )
    return load_world(path)


def rotation_base_camera(mount: CameraMount) -> np.ndarray:
    """Columns are the camera's axes (right, down, ahead) in base: three turns by Rodrigues."""
    about_z = cv2.Rodrigues(np.array([0.0, 0.0, math.radians(mount.yaw_deg)]))[0]
    about_y = cv2.Rodrigues(np.array([0.0, math.radians(mount.pitch_deg), 0.0]))[0]
    about_x = cv2.Rodrigues(np.array([math.radians(mount.roll_deg), 0.0, 0.0]))[0]
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    return about_z @ about_y @ about_x @ level


def seen_by_opencv(
    points_base: np.ndarray, intrinsics: Intrinsics, mount: CameraMount
) -> np.ndarray:
    """Pixels of points in base by cv2.projectPoints, (n, 2)."""
    rotation = rotation_base_camera(mount).T
    place = np.array([mount.x_m, mount.y_m, mount.z_m])
    matrix = np.array(
        [
            [intrinsics.fx_px, 0.0, intrinsics.cx_px],
            [0.0, intrinsics.fy_px, intrinsics.cy_px],
            [0.0, 0.0, 1.0],
        ]
    )
    pixels, _ = cv2.projectPoints(
        np.asarray(points_base, dtype=np.float64),
        Rotation.from_matrix(rotation).as_rotvec(),  # cv2.Rodrigues loses digits near half a turn
        -rotation @ place,
        matrix,
        np.array(intrinsics.distortion),
    )
    return pixels[:, 0]


def to_base(points_world: np.ndarray, pose: tuple[float, float, float]) -> np.ndarray:
    """Points (n, 3) from world to base."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return (points_world - np.array([pose[0], pose[1], 0.0])) @ turn.T
