"""Calibration of a camera from pictures whose truth is known, and of a real lens."""

from __future__ import annotations

import struct
import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from robotctl.config.patch import as_overrides
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.camera.calibration.pattern import Board, draw_board, draw_marker
from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.camera import CameraConfig, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.workbench.camera.calibrate import CameraCalibrateResult, calibrate_camera
from robotctl.workbench.camera.check import check_camera
from robotctl.workbench.camera.options import CameraCalibrateOptions, CheckOptions
from robotctl.workbench.camera.patch import patch_text, patch_values
from robotctl.workbench.camera.pictures import read_picture, write_picture
from tests.workbench.camera.floor_pictures import Sheet, floor_of, picture_of

ROBOT = find_file("diff_drive")
TRUE = CameraMount(0.16, 0.012, 0.295, 1.5, 23.1, -0.8)
BOARD = Board(9, 6, 0.03)
AT = SE2(0.75, 0.05, np.radians(5.0))
MARKERS = {0: (0.6, 0.2), 2: (0.9, 0.4), 3: (0.95, -0.35), 4: (1.4, 0.4), 5: (1.45, -0.5)}


def camera_config() -> CameraConfig:
    camera = load_robot(ROBOT).camera
    assert camera is not None
    return camera


CAMERA = CameraGeometry(camera_config().intrinsics, TRUE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A picture of a board and one of markers, the markers' places, and clicked points."""
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(1)
    board = Sheet(draw_board(BOARD), AT.x_m, AT.y_m, 5.0)
    write_picture(folder / "board.png", picture_of(floor_of([board], rng), CAMERA, rng))
    sheets = [
        Sheet(draw_marker("apriltag_36h11", each, 0.15), *place, 10.0 * each)
        for each, place in MARKERS.items()
    ]
    write_picture(folder / "markers.png", picture_of(floor_of(sheets, rng), CAMERA, rng))
    rows = [f"{each},{x},{y}" for each, (x, y) in MARKERS.items()]
    (folder / "markers.csv").write_text("\n".join(["id,x,y", *rows, "9,1.0,0.0"]))
    ground = np.array([(x, side * 0.35 * x) for x in (0.55, 1.0, 1.7, 2.5) for side in (-1, 1)])
    pixels = CAMERA.project_ground(ground) + rng.normal(scale=0.4, size=ground.shape)
    rows = [f"{u:.2f},{v:.2f},{x},{y}" for (u, v), (x, y) in zip(pixels, ground, strict=True)]
    (folder / "points.csv").write_text("\n".join(["# by hand", "u, v, x, y", *rows]))
    return folder


def calibrated(**options: object) -> CameraCalibrateResult:
    return calibrate_camera(CameraCalibrateOptions(ROBOT, **options), lambda _line: None)  # type: ignore[arg-type]


def assert_true(result: CameraCalibrateResult, sigmas: float = 3.0) -> None:
    """The mount is within so many standard deviations of the truth, and these are not wide."""
    assert result.fit is not None
    for key, sigma in result.fit.sigma.items():
        if key != "f_px":
            off = abs(getattr(result.fit.mount, key) - getattr(TRUE, key))
            assert off < sigmas * sigma, (key, off, sigma)
    assert result.fit.sigma["pitch_deg"] < 0.2
    assert result.fit.sigma["z_m"] < 0.01


def test_a_board_on_the_floor_gives_the_mount(folder: Path) -> None:
    result = calibrated(
        floor=folder / "board.png", square_mm=30.0, at=AT, sigma_px=0.2, sigma_mm=0.2
    )
    assert_true(result)
    assert len(result.points.names) == 54
    assert any("an error of --at shifts all places" in note for note in result.notes)


def test_a_board_that_lies_the_other_way_round_is_told_by_where_the_camera_looks(
    folder: Path,
) -> None:
    turned = SE2(AT.x_m, AT.y_m, AT.theta_rad + np.pi)
    result = calibrated(
        floor=folder / "board.png", square_mm=30.0, at=turned, sigma_px=0.2, sigma_mm=0.2
    )
    assert_true(result)


def test_markers_on_the_floor_give_the_mount_and_those_not_seen_are_named(folder: Path) -> None:
    result = calibrated(floor=folder / "markers.png", markers=folder / "markers.csv")
    assert_true(result)
    assert len(result.points.names) >= 4
    assert any("not seen: " in note and "marker 9" in note for note in result.notes)


def test_clicked_points_give_the_mount_with_the_lens_and_without(folder: Path) -> None:
    assert_true(calibrated(points=folder / "points.csv"))
    result = calibrated(points=folder / "points.csv", lens_unknown=True)
    assert result.fit is not None
    # The lens bends by some pixels; without it the mount is roughly right.
    assert result.fit.mount.pitch_deg == pytest.approx(TRUE.pitch_deg, abs=1.0)
    assert result.fit.intrinsics.fx_px == pytest.approx(457.0, rel=0.05)
    assert any("pixels are assumed square" in note for note in result.notes)


def test_all_sources_go_into_one_fit(folder: Path) -> None:
    result = calibrated(
        floor=folder / "board.png", square_mm=30.0, at=AT, points=folder / "points.csv"
    )
    assert_true(result)
    assert len(result.points.names) == 54 + 8
    alone = calibrated(floor=folder / "board.png", square_mm=30.0, at=AT)
    assert result.expected[-1].calibration_m < 0.5 * alone.expected[-1].calibration_m
    assert alone.advice is not None
    assert result.advice is None


def test_the_patch_makes_the_robot_measure_right(folder: Path, tmp_path: Path) -> None:
    result = calibrated(points=folder / "points.csv")
    patch = tomllib.loads(patch_text(result))
    assert patch["camera"]["mount"].keys() == {
        "x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg"
    }  # fmt: skip
    robot = load_robot(ROBOT, as_overrides(patch_values(result)))
    assert robot.camera is not None
    assert result.fit is not None
    sigma_deg = robot.ground_camera.calibration_sigma_deg
    assert sigma_deg == pytest.approx(result.fit.sigma["pitch_deg"], rel=0.05)
    assert patch["ground_camera"]["calibration_sigma_deg"] == sigma_deg
    camera = CameraGeometry.of(robot.camera)
    truth = np.array([[1.0, 0.2], [2.0, -0.3]])
    off = camera.ground(CAMERA.project_ground(truth)) - truth
    assert np.abs(off).max() < 0.03
    overrides = tuple(as_overrides(patch_values(result)))
    options = CheckOptions(
        folder / "markers.png", ROBOT, markers=folder / "markers.csv", sigma_px=1.0
    )
    check = check_camera(replace(options, overrides=overrides))
    assert check.doubts == []
    before = check_camera(options)
    assert before.doubts
    assert before.errors.off_m[:, 0].max() > 5.0 * np.abs(check.errors.off_m).max()


def test_without_a_camera_in_the_file_a_picture_without_lens_still_gives_all(
    folder: Path, tmp_path: Path
) -> None:
    text = ROBOT.read_text()
    start, end = text.index("[camera]"), text.index("[can]")
    robot = tmp_path / "blind.toml"
    robot.write_text(text[:start] + text[end:])
    options = CameraCalibrateOptions(robot, floor=folder / "board.png", square_mm=30.0, at=AT)
    result = calibrate_camera(options, lambda _line: None)
    tables = tomllib.loads(patch_text(result))["camera"]
    whole = robot.read_text() + patch_text(result)
    patched = tmp_path / "seeing.toml"
    patched.write_text(whole)
    camera = load_robot(patched).camera
    assert camera is not None
    assert camera.mount.z_m == tables["mount"]["z_m"] == pytest.approx(TRUE.z_m, abs=0.05)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({}, ConfigError, "nothing to calibrate from"),
        ({"floor": "board.png"}, ConfigError, "--floor needs --at"),
        ({"at": AT}, ConfigError, "need --floor"),
        ({"lens": ("board.png",), "lens_unknown": True}, ConfigError, "contradict"),
        (
            {"floor": "board.png", "at": AT, "square_mm": 30.0, "board": "7x5"},
            CalibrationError,
            "no chess",
        ),
        ({"floor": "board.png", "markers": "markers.csv"}, CalibrationError, "none of the markers"),
        ({"points": "few.csv"}, CalibrationError, "^3 points; a homography needs 4"),
        ({"points": "line.csv"}, CalibrationError, "lie on a line"),
        ({"points": "swapped.csv"}, CalibrationError, "left and right swapped"),
        ({"points": "words.csv"}, ConfigError, "words.csv:3: y: found 'left', a finite number"),
        ({"points": "heads.csv"}, ConfigError, 'no column x; did you mean "x_m"'),
        (
            {"lens": ("board.png", "b2.png", "b3.png")},
            CalibrationError,
            "3 pictures with the board; 4",
        ),
        ({"lens": ("points.csv",)}, ConfigError, "not a picture"),
    ],
)
def test_what_tells_nothing_is_refused_with_its_reason(
    folder: Path, options: dict[str, object], error: type[Exception], words: str
) -> None:
    lines = (folder / "points.csv").read_text().splitlines()
    for copy in ("b2.png", "b3.png"):
        (folder / copy).write_bytes((folder / "board.png").read_bytes())
    (folder / "few.csv").write_text("\n".join(lines[:5]))
    (folder / "line.csv").write_text("u,v,x,y\n" + "".join(f"{k},{k},{k},1\n" for k in range(6)))
    swapped = [line.split(",") for line in lines[2:]]
    (folder / "swapped.csv").write_text(
        "\n".join(["u,v,x,y", *(f"{u},{v},{x},{-float(y)}" for u, v, x, y in swapped)])
    )
    (folder / "words.csv").write_text("u,v,x,y\n1,2,3,4\n1,2,3,left\n")
    (folder / "heads.csv").write_text("u,v,x_m,y\n1,2,3,4\n")
    located = {
        key: tuple(folder / str(each) for each in value)
        if isinstance(value, tuple)
        else folder / value
        if isinstance(value, str) and key != "board"
        else value
        for key, value in options.items()
    }
    located.setdefault("square_mm", 30.0)
    with pytest.raises(error, match=words):
        calibrated(**located)


@pytest.mark.recordings("camera")
def test_a_real_lens_is_found_as_opencv_published_it(recordings: Path) -> None:
    pictures = tuple(sorted((recordings / "camera").glob("left*.jpg")))
    result = calibrated(lens=pictures, square_mm=25.0)
    lens = result.lens
    assert lens is not None
    storage = cv2.FileStorage(
        str(recordings / "camera" / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ
    )
    K = storage.getNode("camera_matrix").mat()
    assert lens.values[:2] == pytest.approx([K[0, 0], K[1, 1]], rel=0.01)
    assert lens.values[2:4] == pytest.approx([K[0, 2], K[1, 2]], abs=4.0)
    # Theirs has corners of one picture wrong: 1.18 px there, 0.39 px on average.
    assert np.nanmax(lens.rms_px) < 0.2
    assert lens.half_width[0] < 5.0
    published = storage.getNode("distortion_coefficients").mat().ravel()
    assert lens.intrinsics.distortion[0] == pytest.approx(published[0], abs=0.03)


def tagged(picture: Path, folder: Path, orientation: int) -> Path:
    """Write a JPEG with a tag of orientation in its EXIF block, the pixels as they are."""
    tiff = b"MM" + struct.pack(">HIHHHIHHI", 42, 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    segment = b"Exif\0\0" + tiff
    data = picture.read_bytes()
    block = b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment
    file = folder / picture.name
    file.write_bytes(data[:2] + block + data[2:])
    return file


@pytest.mark.recordings("camera")
def test_tags_that_ask_to_turn_the_pictures_do_not_change_the_lens(
    recordings: Path, tmp_path: Path
) -> None:
    pictures = tuple(sorted((recordings / "camera").glob("left*.jpg")))
    turned = tuple(
        tagged(picture, tmp_path, 1 + number % 8) for number, picture in enumerate(pictures)
    )
    assert len(turned) == 13
    plain, other = (
        calibrated(lens=pictures, square_mm=25.0),
        calibrated(lens=turned, square_mm=25.0),
    )
    assert plain.lens is not None
    assert other.lens is not None
    # Two fits of the same pixels differ by the order in which OpenCV's threads add them up.
    np.testing.assert_allclose(other.lens.values, plain.lens.values, rtol=1e-4)
    np.testing.assert_allclose(other.lens.half_width, plain.lens.half_width, rtol=1e-4)
    assert not any("EXIF" in note for note in plain.notes)
    (note,) = (note for note in other.notes if "EXIF" in note)
    assert "left02.jpg" in note
    assert "left01.jpg" not in note


@pytest.mark.recordings("camera")
def test_a_picture_that_a_program_has_turned_is_told_from_one_that_is_only_tagged(
    recordings: Path, tmp_path: Path
) -> None:
    upright, other = (recordings / "camera" / name for name in ("left01.jpg", "left02.jpg"))
    turned = tmp_path / "turned.png"
    write_picture(turned, np.ascontiguousarray(np.rot90(read_picture(other))))
    said = "left01.jpg: 640 x 480 and .*turned.png: 480 x 640; one has been rotated"
    with pytest.raises(ConfigError, match=said):
        calibrated(lens=(upright, turned), square_mm=25.0)
    with pytest.raises(ConfigError, match=r"480 x 640 pixels, but .* one has been rotated"):
        calibrated(floor=turned, square_mm=30.0, at=AT)


@pytest.mark.recordings("camera")
def test_the_mount_from_a_real_picture_is_the_pose_of_opencv(recordings: Path) -> None:
    pictures = tuple(sorted((recordings / "camera").glob("left*.jpg")))
    result = calibrated(
        lens=pictures, square_mm=25.0, floor=pictures[2], at=SE2(0.5, 0.0, 0.0),
        sigma_px=0.3, sigma_mm=0.1,
    )  # fmt: skip
    fit = result.fit
    assert fit is not None
    places = np.column_stack([result.points.ground, np.zeros(54)])
    _, rotation, translation = cv2.solvePnP(
        places,
        result.points.pixels,
        np.array(
            [
                [fit.intrinsics.fx_px, 0.0, fit.intrinsics.cx_px],
                [0.0, fit.intrinsics.fy_px, fit.intrinsics.cy_px],
                [0.0, 0.0, 1.0],
            ]
        ),
        np.array(fit.intrinsics.distortion),
    )
    R = cv2.Rodrigues(rotation)[0].T
    assert fit.camera.R_base_camera == pytest.approx(R, abs=2e-3)
    assert fit.camera.t_base_camera == pytest.approx(-(R @ translation).ravel(), abs=1e-3)


@pytest.mark.recordings("camera")
def test_a_part_of_a_board_is_pointed_out(recordings: Path) -> None:
    picture = recordings / "camera" / "left02.jpg"
    for columns, said in ((8, True), (9, False)):
        result = calibrated(floor=picture, board=f"{columns}x6", square_mm=25.0, at=SE2())
        notes = [note for note in result.notes if "seems to have 9 x 6 inner corners" in note]
        assert bool(notes) == said


def test_a_picture_of_another_size_is_refused(folder: Path, tmp_path: Path) -> None:
    small = cv2.resize(read_picture(folder / "board.png"), (320, 240))
    write_picture(tmp_path / "small.png", small.astype(np.uint8))
    with pytest.raises(
        ConfigError, match=r"320 x 240 pixels, but the lens is for 640 x 480; .* has another lens$"
    ):
        calibrated(floor=tmp_path / "small.png", square_mm=30.0, at=AT)
