"""`robotctl camera ranges` and `obstacles` as a user calls them."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from robotctl.config.robot_file import find_file, load_robot
from robotctl.model.sensors.camera import CameraIntrinsics
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.workbench.camera.seeing import OBSTACLE_KEYS, RANGE_KEYS
from tests.cli.command import status_of
from tests.estimation.camera.camera_pictures import Block, Scene, room, speckled

SETTINGS = [
    word
    for key, value in (
        ("width_px", "320"),
        ("height_px", "240"),
        ("fx_px", "228.0"),
        ("fy_px", "228.0"),
        ("cx_px", "159.5"),
        ("cy_px", "119.5"),
    )
    for word in ("--set", f"camera.intrinsics.{key}={value}")
]
BOX = Block(1.2, 0.2, 0.1, 0.1, 0.12, (0.15, 0.2, 0.6))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two pictures, one with a box and one without, by a camera of half the size."""
    camera = load_robot(find_file("diff_drive")).camera
    assert camera is not None
    lens = CameraIntrinsics(320, 240, 228.0, 228.0, 159.5, 119.5, camera.intrinsics.distortion)
    geometry = CameraGeometry(lens, camera.mount)
    folder = tmp_path_factory.mktemp("pictures")
    for name, blocks in (("box", (BOX,)), ("empty", ())):
        scene = Scene(blocks, speckled(), room(2.4, (0.75, 0.6, 0.5)))
        cv2.imwrite(str(folder / f"{name}.png"), scene.picture(geometry))
    return folder


def run(*arguments: object) -> tuple[int, str]:
    """Return the status of the command line, and all that it says."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = status_of("camera", *arguments, *SETTINGS)
    return status, said.getvalue()


def test_ranges_of_a_folder_go_to_tables_and_pictures(pictures: Path, tmp_path: Path) -> None:
    table, report = tmp_path / "ranges.csv", tmp_path / "ranges.json"
    code, output = run("ranges", pictures, "--out", tmp_path, "--csv", table, "--json", report)
    assert code == 0, output
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == RANGE_KEYS
    assert {row["picture"] for row in rows} == {"box.png", "empty.png"}
    ahead = [r for r in rows if r["picture"] == "empty.png" and abs(float(r["angle_deg"])) < 10]
    assert ahead
    assert [float(r["x_m"]) for r in ahead] == pytest.approx([2.4] * len(ahead), rel=0.04)
    entries = json.loads(report.read_text(encoding="utf-8"))["pictures"]
    assert [entry["picture"] for entry in entries] == ["box.png", "empty.png"]
    assert all(entry["trusted"] for entry in entries)
    assert len(entries[0]["ranges"]) == 80
    drawn = cv2.imread(str(tmp_path / "box_seen.png"))
    plain = cv2.imread(str(pictures / "box.png"))
    assert drawn.shape == plain.shape
    assert np.any(drawn != plain)


def test_obstacles_are_told_with_place_and_size(pictures: Path, tmp_path: Path) -> None:
    report, out = tmp_path / "things.json", tmp_path / "seen.png"
    code, output = run("obstacles", pictures / "box.png", "--json", report, "--out", out)
    assert code == 0, output
    assert out.is_file()
    (entry,) = json.loads(report.read_text(encoding="utf-8"))["pictures"]
    (thing,) = entry["obstacles"]
    assert set(thing) == set(OBSTACLE_KEYS) - {"picture"}
    assert [thing["centre_x_m"], thing["centre_y_m"]] == pytest.approx([BOX.x, BOX.y], abs=0.04)
    code, output = run("obstacles", pictures / "empty.png", "--json", report)
    assert json.loads(report.read_text(encoding="utf-8"))["pictures"][0]["obstacles"] == []


def test_without_files_the_table_is_shown(pictures: Path) -> None:
    code, output = run("obstacles", pictures / "box.png")
    assert code == 0
    assert "box.png" in output
    assert "width" in output


def test_a_picture_that_is_not_trusted_is_named_and_gives_status_1(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "dark.png"), np.zeros((240, 320, 3), np.uint8))
    code, output = run("ranges", tmp_path / "dark.png")
    assert code == 1
    assert "too dark" in output


def test_pictures_of_a_sequence_are_seen_on_the_floor_of_the_first(
    pictures: Path, tmp_path: Path
) -> None:
    red = np.full((240, 320, 3), (40, 60, 200), np.uint8)
    noise = np.random.default_rng(1).integers(-8, 8, red.shape)
    red[120:] = np.clip(red[120:] + noise[120:], 0, 255)
    red[:120] = (200, 180, 90)
    cv2.imwrite(str(tmp_path / "red.png"), red)
    files = (pictures / "empty.png", tmp_path / "red.png")
    assert run("ranges", *files)[0] == 0
    code, output = run("ranges", *files, "--sequence")
    assert code == 1
    assert "red.png: not trusted: what is in front does not look like the floor" in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing*.png"], "nothing*.png: no pictures found"),
        (
            ["{pictures}", "--out", "one.png"],
            "--out one.png: not a folder; for 2 pictures make one first",
        ),
        (["{pictures}/box.png", "--out", "one.xyz"], "one.xyz: the suffix must be one of .png"),
        (["{pictures}/box.png", "--csv", "no/such.csv"], "such.csv: the folder no does not exist"),
        (["{pictures}/none.png"], "{pictures}/none.png: No such file or directory"),
        (["{pictures}/box.png", "--robot", "diff_driv"], 'did you mean "diff_drive"?'),
        (["{pictures}/box.png", "--robot", "tricycle"], "tricycle.toml: camera.mount: missing key"),
    ],
)
def test_wrong_input_is_said_plainly(arguments: list[str], message: str, pictures: Path) -> None:
    code, output = run("ranges", *(word.format(pictures=pictures) for word in arguments))
    assert code == 2
    assert message.format(pictures=pictures) in output


def test_a_picture_of_another_size_is_refused(tmp_path: Path) -> None:
    large = tmp_path / "large.png"
    cv2.imwrite(str(large), np.zeros((480, 640, 3), np.uint8))
    code, output = run("ranges", large)
    assert code == 2
    assert f"{large}: 640 x 480 pixels, but the lens is for 320 x 240" in output
