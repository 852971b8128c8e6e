"""What pixels of the simulated camera look like: floor, shadows, noise, lens."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from firmware_sim.camera.camera import Camera
from firmware_sim.camera.floor import PERIOD_M, PIECES, SIDE, floor_laying, floor_texture
from firmware_sim.camera.light import floor_light
from firmware_sim.camera.scene import make_scene
from firmware_sim.camera.snapshot import main, png
from firmware_sim.world.world import World, load_world
from tests.firmware_sim.camera.camera_rig import CLEAN, CONFIGS, DIFF, PINHOLE, SMALL, robot, room

EMPTY = World.from_segments(np.empty((0, 4)))
EVEN = {"simulation.camera.ambient": 1.0}
DOWN = {"camera.mount.pitch_deg": 90.0, "camera.mount.x_m": 0.0, "camera.mount.z_m": 0.3}


def texels(name: str) -> np.ndarray:
    """Return the finest copy of a floor, (SIDE, SIDE, 3) blue, green, red."""
    packed = floor_texture(name, 0).texels[: SIDE * SIDE].reshape(SIDE, SIDE)
    return np.stack([packed & 255, (packed >> 8) & 255, packed >> 16], axis=-1).astype(float)


def looked_up(name: str, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Colour of the floor at points: bilinear by scipy, piece by piece."""
    laying = floor_laying(name, 0)
    row = np.floor(y_m / laying.size[1]).astype(int)
    along_m = x_m + laying.shift[row % PIECES]
    piece = np.floor(along_m / laying.size[0]).astype(int)
    cut = laying.cut[row % PIECES, piece % PIECES]
    x_m, y_m = along_m - piece * laying.size[0], y_m - row * laying.size[1]
    at = [(y_m + cut[..., 1]) / PERIOD_M * SIDE - 0.5, (x_m + cut[..., 0]) / PERIOD_M * SIDE - 0.5]
    picture = texels(name)
    return np.stack(
        [map_coordinates(picture[..., c], at, order=1, mode="grid-wrap") for c in range(3)], -1
    )


def test_from_above_the_floor_is_its_pattern_at_the_right_place(tmp_path: Path) -> None:
    world = room(tmp_path, '[floor]\ntexture = "concrete"\n')
    camera = Camera(robot(CLEAN, EVEN, PINHOLE, SMALL, DOWN), world)
    pose = (-3.1, 1.7, 0.7)
    picture = camera.look(*pose).picture
    v, u = np.mgrid[0:120, 0:160]
    # Straight down the picture's right is the robot's right, its top is ahead.
    ahead, left = -(v - 59.5) * 0.3 / 114.0, -(u - 79.5) * 0.3 / 114.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x_m, y_m = pose[0] + c * ahead - s * left, pose[1] + s * ahead + c * left
    expected = looked_up("concrete", x_m, y_m)
    # Texels and pixels are about alike, so that some pixels take the next coarser copy.
    fine = np.abs(picture - expected).max(axis=2) <= 2.0
    assert np.mean(fine) > 0.5
    assert np.abs(np.mean(picture - expected)) < 0.7
    moved = looked_up("concrete", x_m + 0.004, y_m)
    assert np.mean(np.abs(picture - expected)) < 0.5 * np.mean(np.abs(picture - moved))


@pytest.mark.parametrize("name", ["tiles", "wood", "carpet", "concrete"])
def test_far_floor_is_nearer_to_what_a_pixel_covers_than_to_a_point_in_it(
    name: str, tmp_path: Path
) -> None:
    world = room(tmp_path, f'[floor]\ntexture = "{name}"\n')
    camera = Camera(robot(CLEAN, EVEN, PINHOLE, SMALL), world)
    picture = camera.look(0.0, 0.0, 0.0).picture[28:70].astype(float)
    fine = (np.arange(6) + 0.5) / 6.0 - 0.5
    pitch = math.radians(22.0)

    def floor(v: np.ndarray, u: np.ndarray) -> np.ndarray:
        y = (v - 59.5) / 114.0
        far = 0.3 / (math.sin(pitch) + y * math.cos(pitch))
        x_m = 0.15 + far * (math.cos(pitch) - y * math.sin(pitch))
        return looked_up(name, x_m, -far * (u - 79.5) / 114.0)

    v, u = np.mgrid[28:70, 0:160]
    covered = sum(floor(v + a, u + b) for a in fine for b in fine) / 36.0
    point = floor(v.astype(float), u.astype(float))
    ours = np.sqrt(np.mean((picture - covered) ** 2))
    naive = np.sqrt(np.mean((point - covered) ** 2))
    assert ours < 0.62 * naive


def test_a_lamps_shadow_is_where_the_light_over_the_edge_comes_down(tmp_path: Path) -> None:
    world = room(
        tmp_path,
        "[[lamp]]\nat = [0.0, 0.0, 2.0]\n"
        "[[box]]\ncentre = [1.0, 0.0]\nsize = [0.2, 0.6]\nheight_m = 0.5\n",
    )
    light = floor_light(world, make_scene(world), 0.3)

    def at(x_m: float, y_m: float) -> float:
        row, column = (
            round((y_m - light.y_m) / light.cell_m),
            round((x_m - light.x_m) / light.cell_m),
        )
        return float(light.cells[row, column])

    # The far upper edge at x = 1.1, z = 0.5 throws to 1.1 * 2.0 / 1.5; the lamp is 0.12 m wide.
    end = 1.1 * 2.0 / 1.5
    blur = 0.12 * 0.5 / 1.5 + 0.03
    assert at(end - blur, 0.0) == pytest.approx(0.3)
    assert at(1.15, 0.0) == pytest.approx(0.3)
    assert at(end + blur, 0.0) > 0.6
    assert at(0.85, 0.0) > 0.6
    assert 0.3 < at(end, 0.0) < at(end + blur, 0.0)
    # Lambert's law: the cosine to the third power, but for a fade to the end of its reach.
    assert (at(0.0, 2.0) - 0.3) / (at(0.0, 0.0) - 0.3) == pytest.approx(
        2**-1.5 * (1 - 4 / 64), rel=0.02
    )
    # Between dark and lit lie several steps: the lamp is wide, and hidden bit by bit.
    steps = [at(x_m, 0.0) for x_m in np.arange(end - blur, end + blur, light.cell_m)]
    lit = (np.array(steps) - 0.3) / (at(end + blur, 0.0) - 0.3)
    assert np.sum((lit > 0.1) & (lit < 0.9)) >= 3


def test_shadows_change_the_floor_and_nothing_else() -> None:
    world = load_world(CONFIGS / "worlds" / "clutter.toml")
    pose = (0.8, 2.5, 0.2)
    even = Camera(robot(CLEAN, SMALL, EVEN), world).look(*pose)
    lit = Camera(robot(CLEAN, SMALL, {"simulation.camera.ambient": 0.2}), world).look(*pose)
    assert np.array_equal(even.labels, lit.labels)
    assert np.array_equal(even.distances, lit.distances)
    things = even.labels != -1
    assert np.array_equal(even.picture[things], lit.picture[things])
    ratio = lit.picture[~things].sum(axis=1) / even.picture[~things].sum(axis=1)
    assert ratio.min() < 0.4
    assert ratio.max() > 0.9


NOISY = {"simulation.camera.read_noise": 2.0, "simulation.camera.shot_noise": 0.08}


def test_noise_has_the_variance_that_is_said_and_no_memory() -> None:
    config = robot(CLEAN, NOISY)
    camera = Camera(config, EMPTY, seed=4)
    clean = Camera(robot(CLEAN), EMPTY).look(0.0, 0.0, 0.0).picture.astype(float)
    first = camera.look(0.0, 0.0, 0.0, 1).picture - clean
    second = camera.look(0.0, 0.0, 0.0, 2).picture - clean
    for low in (120, 130, 140, 150):
        there = (clean >= low) & (clean < low + 10)
        assert np.count_nonzero(there) > 15_000
        # Rounding, of the noisy picture and of the clean one, adds 1/12 each.
        expected = 2.0**2 + 0.08 * clean[there].mean() + 1 / 6
        assert first[there].var() == pytest.approx(expected, rel=0.05)
        assert abs(first[there].mean()) < 0.15
    for a, b in (
        (first, second),
        (first[:, 1:], first[:, :-1]),
        (first[1:], first[:-1]),
        (first[..., 0], first[..., 1]),
    ):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.01


def test_the_same_seed_and_number_give_the_same_picture_and_others_do_not() -> None:
    def look(seed: int, number: int) -> np.ndarray:
        return Camera(robot(SMALL), EMPTY, seed).look(0.3, 0.2, 0.1, number).picture

    assert np.array_equal(look(1, 5), look(1, 5))
    assert not np.array_equal(look(1, 5), look(1, 6))
    assert not np.array_equal(look(1, 5), look(2, 5))


def test_vignetting_takes_from_the_corners_what_is_said() -> None:
    world = World.from_segments([(0.5, -9.0, 0.5, 9.0)])
    flat = Camera(robot(CLEAN, SMALL), world)
    dim = Camera(robot(CLEAN, SMALL, {"simulation.camera.vignetting": 0.4}), world)
    share = dim.look(0.0, 0.0, 0.0).picture[0] / flat.look(0.0, 0.0, 0.0).picture[0]
    assert share[0].mean() == pytest.approx(0.6, abs=0.01)
    assert share[0].mean() < share[40].mean() < share[80].mean()


def test_blur_spreads_an_edge_by_its_variance(tmp_path: Path) -> None:
    text = '[[wall]]\npoints = [[3.0, -9.0], [3.0, 0.0]]\ncolour = "#000000"\n'
    text += '[[wall]]\npoints = [[3.0, 0.0], [3.0, 9.0]]\ncolour = "#ffffff"\n'
    world = room(tmp_path, text)
    settings = (CLEAN, SMALL, PINHOLE, {"camera.mount.pitch_deg": 0.0})
    blurred = Camera(robot(*settings, {"simulation.camera.blur_px": 0.6}), world)
    row = blurred.look(0.0, 0.0, 0.0).picture[55].astype(float).mean(axis=1)
    spread = -np.diff(row) / (row[0] - row[-1])
    edge = slice(70, 90)
    at = np.arange(159)[edge]
    weight = np.clip(spread[edge], 0, None)
    weight[weight < 0.02] = 0.0
    mean = np.average(at, weights=weight)
    assert np.average((at - mean) ** 2, weights=weight) == pytest.approx(0.36, abs=0.03)


def test_a_png_is_read_back_by_opencv() -> None:
    rng = np.random.default_rng(1)
    for shape, kind in (((7, 5, 3), np.uint8), ((4, 9), np.uint8), ((4, 9), np.uint16)):
        image = rng.integers(0, np.iinfo(kind).max, shape, dtype=kind, endpoint=True)
        read = cv2.imdecode(np.frombuffer(png(image), np.uint8), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(read, image)


def test_snapshots_come_with_their_truth(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    small = [f"--set={key}={value}" for key, value in SMALL.items()]
    world = str(CONFIGS / "worlds" / "clutter.toml")
    common = ["--robot", str(DIFF), "--world", world, *small]
    assert (
        main([*common, "--pose", "0.8,2.5,0", "--random", "2", "--out", str(tmp_path / "a")]) == 0
    )
    truth = json.loads((tmp_path / "a.json").read_text())
    assert [each["file"] for each in truth["pictures"]] == [f"a-00{i}.png" for i in range(3)]
    first = truth["pictures"][0]
    middle = len(truth["angles_rad"]) // 2
    assert truth["angles_rad"][middle] == pytest.approx(0.0)
    assert first["ranges_m"][middle] == pytest.approx(3.9 - 0.95 - 0.05, abs=0.002)  # the bottle
    assert "cup" in {each["name"] for each in first["things"]}
    picture = cv2.imread(str(tmp_path / "a-000.png"))
    assert picture.shape == (120, 160, 3)
    # Beside the pictures labels would pass for some, where `robotctl camera` is given the folder.
    assert {each.name for each in tmp_path.glob("*.png")} == {f"a-00{i}.png" for i in range(3)}
    labels = cv2.imread(str(tmp_path / "labels" / "a-000.png"), cv2.IMREAD_UNCHANGED)
    expected = Camera(robot(SMALL), load_world(Path(world))).look(0.8, 2.5, 0.0).labels
    assert expected.dtype == np.int16
    assert np.array_equal(labels, expected + 2)
    assert main([*common, "--out", str(tmp_path / "b")]) == 2
    assert "give --pose X,Y,HEADING_DEG or --random N" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (["--pose", "1,2"], "--pose: '1,2' is not X,Y,HEADING_DEG"),
        (["--pose", "1,nan,0"], "--pose: '1,nan,0' is not finite"),
        (["--pose", "-1,2,0"], "needs `=`, as --start=-1,2,90"),
        (["--random", "-1"], "--random"),
        (["--random", "1.5"], "--random: '1.5' is no whole number from 0 on"),
        (["--seed", "-1"], "--seed"),
    ],
)
def test_a_wrong_option_of_a_snapshot_is_told_in_a_line(
    wrong: list[str], said: str, capsys: pytest.CaptureFixture
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--robot=r.toml", "--world=w.toml", "--out=a", *wrong])
    message = capsys.readouterr().err
    assert ended.value.code == 2
    assert said in message
    assert message.count("\n") == 1


def test_that_there_is_room_for_no_pose_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    body = np.array(robot().simulation.body)
    (low_x, low_y), (high_x, high_y) = body.min(axis=0) - 1e-3, body.max(axis=0) + 1e-3
    room(
        tmp_path,
        f"[[wall]]\npoints = [[{low_x}, {low_y}], [{high_x}, {low_y}], [{high_x}, {high_y}], "
        f"[{low_x}, {high_y}]]\nclosed = true\n",
    )
    world = tmp_path / "room.toml"
    tight = f"{low_x}, {low_y}, {high_x}, {high_y}"
    world.write_text(world.read_text().replace("-6.0, -6.0, 6.0, 6.0", tight))
    common = ["--robot", str(DIFF), "--world", str(world), "--out", str(tmp_path / "a")]
    assert main([*common, "--random", "1"]) == 2
    assert "--random 1: no room was found for pose 1" in capsys.readouterr().err
