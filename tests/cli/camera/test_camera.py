"""`robotctl camera` at the command line: what it prints, writes and returns."""

from __future__ import annotations

import struct
import tomllib
import zlib

import cv2
import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.estimation.camera.calibration.pattern import (
    Board,
    draw_board,
    find_corners,
    find_markers,
)
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.workbench.camera.pictures import read_picture, write_picture
from tests.cli.command import status_of
from tests.workbench.camera.floor_pictures import Sheet, floor_of, picture_of


@pytest.fixture
def camera():
    return CameraGeometry.of(load_robot(find_file("diff_drive")).camera)


@pytest.fixture
def points(tmp_path, camera):
    ground = np.array([(x, side * 0.3 * x) for x in (0.5, 1.0, 1.8, 2.8) for side in (-1, 1)])
    pixels = camera.project_ground(ground)
    rows = [f"{u:.2f},{v:.2f},{x},{y}" for (u, v), (x, y) in zip(pixels, ground, strict=True)]
    path = tmp_path / "points.csv"
    path.write_text("\n".join(["u,v,x,y", *rows]))
    return path


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "picture.png"
    write_picture(path, np.full((480, 640, 3), 120, np.uint8))
    return path


def run(*arguments):
    return status_of("camera", *arguments)


def test_clicked_points_give_tables_and_a_patch(capsys, tmp_path, points):
    patch = tmp_path / "patch.toml"
    assert run("calibrate", "--points", points, "--out", patch) == 0
    printed = capsys.readouterr()
    for word in ("camera.mount.pitch_deg", "95 % interval", "expected error", "homography", "chi2"):
        assert word in printed.out
    assert "the points are spread well" in printed.out
    assert tomllib.loads(patch.read_text())["camera"]["mount"]["pitch_deg"] == pytest.approx(
        22.0, abs=0.01
    )
    assert "robotctl config check" in printed.out
    assert "fitting the mount" in printed.err


def test_points_that_are_near_get_the_advice_where_to_put_more(capsys, points):
    points.write_text("\n".join(points.read_text().splitlines()[:5]))
    assert run("calibrate", "--points", points, "--sigma-px", 1) == 0
    printed = capsys.readouterr().out
    assert "not spread enough" in printed
    assert "add markers on the floor at about (x, y) = (" in printed
    assert "hardly check each other" in printed


def test_a_wrong_point_is_named(capsys, points):
    lines = points.read_text().splitlines()
    u, v, x, y = lines[4].split(",")
    lines[4] = f"{u},{v},{x},{float(y) + 0.1}"
    points.write_text("\n".join(lines))
    assert run("calibrate", "--points", points) == 0
    assert "left out because they contradict the others: point 4" in capsys.readouterr().out


def test_of_a_running_robot_one_picture_is_taken_for_all_that_needs_it(
    monkeypatch, capsys, tmp_path, camera
):
    rng = np.random.default_rng(1)
    board = Sheet(draw_board(Board(9, 6, 0.03)), 0.75, 0.05, 5.0)
    pictures = [picture_of(floor_of([board], rng), camera, rng)]

    def only_one(instance, _clock):
        assert instance == "rover"
        return pictures.pop()

    monkeypatch.setattr("robotctl.workbench.camera.pictures.live_picture", only_one)
    words = ("--floor", "live:rover", "--at", "0.75,0.05,5", "--square-mm", 30, "--lens-unknown")
    shown = tmp_path / "seen.png"
    assert run("calibrate", *words, "--show", shown) == 0
    assert pictures == []
    assert read_picture(shown).shape == (480, 640, 3)
    assert "54 points" in capsys.readouterr().out


def test_what_the_points_do_not_tell_ends_with_1_and_bad_input_with_2(capsys, tmp_path, points):
    few = tmp_path / "few.csv"
    few.write_text("\n".join(points.read_text().splitlines()[:4]))
    assert run("calibrate", "--points", few) == 1
    assert "a homography needs 4" in capsys.readouterr().err
    for words, said in (
        (("--points", points, "--board", "9by6"), "not of the form 9x6"),
        (("--points", points, "--at", "1;2"), "--at 1;2: not of the form"),
        (("--points", points, "--sigma-px", 0), "sigma_px must be > 0"),
        (("--points", points, "--family", "apriltag_36h10"), 'mean "apriltag_36h11"'),
        (("--lens", tmp_path / "no*.png"), "no pictures found"),
        (("--points", points, "--show", tmp_path / "x.png"), "--show needs --floor"),
        (("--points", tmp_path / "none.csv"), "No such file"),
        (("--points", points, "--out", tmp_path / "no" / "patch.toml"), "does not exist"),
    ):
        assert run("calibrate", *words) == 2
        assert said in capsys.readouterr().err


def test_check_says_how_far_the_camera_is_off(capsys, tmp_path, points):
    plot = tmp_path / "errors.png"
    assert run("check", "--points", points, "--plot", plot) == 0
    printed = capsys.readouterr().out
    assert "as good as 0.5 px and 1 mm let expect" in printed
    assert plot.read_bytes().startswith(b"\x89PNG")
    tilted = ("--set", "camera.mount.pitch_deg=23")
    assert run("check", "--points", points, *tilted) == 3
    printed = capsys.readouterr().out
    assert "The calibration is off" in printed
    # Seen as pitched further down than it is, all is told too near.
    row = next(line for line in printed.splitlines() if "2 to 3" in line and "│" in line)
    assert float(row.split("│")[3]) < -100.0
    assert run("check") == 2
    assert "nothing to check against" in capsys.readouterr().err


def test_floor_draws_from_above_and_tells_pixels_in_metres(capsys, tmp_path, picture, camera):
    clicked, told, above = (tmp_path / name for name in ("uv.csv", "xy.csv", "above.png"))
    pixel = camera.project_ground(np.array([[1.2, -0.3]]))[0]
    clicked.write_text(f"u,v\n{pixel[0]:.3f},{pixel[1]:.3f}\n320,2\n")
    options = ("--pixels", clicked, "--points", told, "--out", above, "--resolution", 0.01)
    assert run("floor", picture, *options) == 0
    heading, place, sky = told.read_text().splitlines()
    assert heading == "u,v,x_m,y_m,sigma_x_m,sigma_y_m"
    assert [float(word) for word in place.split(",")[2:4]] == pytest.approx([1.2, -0.3], abs=1e-3)
    assert sky.endswith(",,,,")
    assert read_picture(above).shape == (300, 300, 3)
    assert run("floor", picture, "--pixels", clicked) == 0
    assert "the floor" in capsys.readouterr().out
    for words, said in (
        ((picture,), "nothing to do"),
        ((picture, "--points", told), "--points needs --pixels"),
        ((picture, "--out", above, "--far", -1), "near_m 0 must be less than far_m -1"),
        ((picture, "--out", above, "--resolution", 1e-5), "allowed are 1 to 8000"),
        ((clicked, "--out", above), "not a picture"),
        ((picture, "--out", tmp_path / "above.txt"), "the suffix must be one of"),
        ((picture, "--out", above, "--robot", "tricycle"), "no table [camera]"),
    ):
        assert run("floor", *words) == 2
        assert said in capsys.readouterr().err


def test_patterns_are_found_in_their_own_picture_and_say_their_size(capsys, tmp_path):
    board, marker = tmp_path / "board.png", tmp_path / "marker.png"
    assert run("pattern", "--out", board, "--board", "7x5", "--square-mm", 30) == 0
    assert "Print it at 100 %" in capsys.readouterr().out
    assert run("pattern", "--out", marker, "--marker", 42, "--side-mm", 100) == 0
    data = board.read_bytes()
    at = data.index(b"pHYs")
    assert struct.unpack(">IIB", data[at + 4 : at + 13]) == (10_000, 10_000, 1)
    assert struct.unpack(">I", data[at + 13 : at + 17])[0] == zlib.crc32(data[at : at + 13])
    small = cv2.resize(read_picture(board), None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA)
    corners = find_corners(small.astype(np.uint8), Board(7, 5, 0.03))
    assert corners.shape == (35, 2)
    # 30 mm at 10 px per mm, a fifth of it.
    assert corners[1] - corners[0] == pytest.approx((60.0, 0.0), abs=0.1)
    small = cv2.resize(read_picture(marker), None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA)
    assert list(find_markers(small.astype(np.uint8), "apriltag_36h11")) == [42]
    assert run("pattern", "--out", marker, "--marker", 600) == 2
    assert "has the markers 0 to 586, not 600" in capsys.readouterr().err
