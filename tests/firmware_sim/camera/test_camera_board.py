"""Boards on the simulated floor: found by OpenCV where they lie, and good to calibrate with."""

from __future__ import annotations

import math
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest

from firmware_sim.camera.board import INK, PAPER, board_rows, board_value
from firmware_sim.camera.camera import Camera
from firmware_sim.camera.snapshot import png
from firmware_sim.world.shapes import Board
from robotctl.cli import main as command_line
from tests.firmware_sim.camera.camera_rig import DIFF, robot, room, seen_by_opencv, to_base

ERRORS = {
    "simulation.camera.pitch_error_deg": 1.5,
    "simulation.camera.yaw_error_deg": -1.0,
    "simulation.camera.roll_error_deg": 0.8,
    "simulation.camera.z_error_m": 0.01,
}


def test_squares_of_a_board_change_at_each_side_and_end_in_a_margin() -> None:
    (row,) = board_rows((Board((0.0, 0.0), 90.0, (3, 2), 0.1),))
    # Along the arrow, which points to y, there are three squares, across it four.
    assert board_value(row, -0.15, -0.1) == board_value(row, 0.05, -0.1) == PAPER
    assert board_value(row, -0.05, -0.1) == board_value(row, -0.15, 0.0) == INK
    assert board_value(row, 0.29, 0.0) == board_value(row, 0.0, 0.24) == PAPER
    assert board_value(row, 0.31, 0.0) == board_value(row, 0.0, 0.26) == -1.0


def test_opencv_finds_the_corners_of_a_board_where_it_projects_them(tmp_path: Path) -> None:
    world = room(
        tmp_path,
        "[[board]]\nat = [0.8, 0.1]\nheading_deg = 20.0\nsquare_m = 0.04\n",
    )
    camera = Camera(robot(ERRORS), world, seed=2)
    pose = (0.05, -0.05, 0.1)
    grey = cv2.cvtColor(camera.look(*pose).picture, cv2.COLOR_BGR2GRAY)
    found, rough = cv2.findChessboardCorners(grey, (9, 6))
    assert found
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    corners = cv2.cornerSubPix(grey, rough, (4, 4), (-1, -1), criteria).reshape(-1, 2)
    ahead, left = np.meshgrid((2.5 - np.arange(6)) * 0.04, (4.0 - np.arange(9)) * 0.04)
    c, s = math.cos(math.radians(20.0)), math.sin(math.radians(20.0))
    places = np.stack([0.8 + c * ahead - s * left, 0.1 + s * ahead + c * left, 0 * ahead], -1)
    pixels = seen_by_opencv(to_base(places.reshape(-1, 3), pose), camera.intrinsics, camera.mount)
    # The order in which they are found is OpenCV's own.
    apart = np.linalg.norm(corners[:, None] - pixels[None], axis=2)
    nearest = np.argmin(apart, axis=1)
    assert len(set(nearest)) == 54
    error = corners - pixels[nearest]
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.abs(error.mean(axis=0)).max() < 0.02


def test_a_camera_mounted_wrong_is_put_right_by_a_picture_of_a_board(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = room(tmp_path, "[[board]]\nat = [0.9, 0.0]\nsquare_m = 0.08\n")
    camera = Camera(robot(ERRORS), world, seed=3)
    (tmp_path / "floor.png").write_bytes(png(camera.look(0.0, 0.0, 0.0).picture))
    patch = tmp_path / "patch.toml"
    arguments = f"--floor {tmp_path}/floor.png --at 0.9,0,0 --board 9x6 --square-mm 80"
    command = ["robotctl", "camera", "calibrate", "--robot", str(DIFF), *arguments.split()]
    monkeypatch.setattr(sys, "argv", [*command, "--out", str(patch)])
    with pytest.raises(SystemExit) as ended:
        command_line.main()
    assert not ended.value.code, capsys.readouterr()
    mount = tomllib.loads(patch.read_text())["camera"]["mount"]
    truth = camera.mount
    assert mount["pitch_deg"] == pytest.approx(truth.pitch_deg, abs=0.1)
    assert mount["roll_deg"] == pytest.approx(truth.roll_deg, abs=0.1)
    assert mount["yaw_deg"] == pytest.approx(truth.yaw_deg, abs=0.15)
    assert mount["z_m"] == pytest.approx(truth.z_m, abs=0.0015)
    assert mount["x_m"] == pytest.approx(truth.x_m, abs=0.002)
