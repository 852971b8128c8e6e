"""A ROS map as a world: what its sensors see and what it touches, against a look at every cell."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim.camera.camera import Camera
from firmware_sim.camera.truth import true_ranges
from firmware_sim.config.parameters import LidarParameters
from firmware_sim.errors import SimulationError
from firmware_sim.faults.scenario import load_scenario, play
from firmware_sim.plant.plant import Plant
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.sensors.rays import cast_fan
from firmware_sim.sensors.sonar import SonarRing
from firmware_sim.simulation import Simulation
from firmware_sim.world.cells import Cells
from firmware_sim.world.ros_map import load_cells
from firmware_sim.world.world import World, load_world
from robotctl.maps.map_file import load_map
from tests.firmware_sim.camera.camera_rig import CLEAN, DIFF, robot
from tests.firmware_sim.plant.plants import command
from tests.firmware_sim.world.cell_rooms import (
    cells,
    in_cells,
    ray_range,
    room_map,
    room_world,
)

EXACT = LidarParameters(sigma_m=0.0, dropout_probability=0.0, beams=72, x_m=0.1, heading_deg=20.0)
QUIET = {
    "simulation.sonar.sigma_m": 0.0,
    "simulation.sonar.sigma_per_m": 0.0,
    "simulation.sonar.outlier_probability": 0.0,
    "simulation.sonar.dropout_probability": 0.0,
    "simulation.sonar.crosstalk_probability": 0.0,
}
ANGLED = (-1.0, 2.0, 0.4)


def world_of(each: Cells) -> World:
    """Return a world of cells that are in no file."""
    return dataclasses.replace(
        World.from_segments(each.walls()), corners=each.corners(), cells=each
    )


def known_cells(world: World) -> Cells:
    assert world.cells is not None
    return world.cells


def free_poses(world: World, count: int, seed: int) -> list[tuple[float, float, float]]:
    """Draw poses of the middle of the default robot at which it touches nothing."""
    plant, rng = Plant(robot(), world, np.random.default_rng(1)), np.random.default_rng(seed)
    low_x, low_y, high_x, high_y = world.bounds
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        x, y = rng.uniform((low_x, low_y), (high_x, high_y)).tolist()
        pose = (x, y, float(rng.uniform(-math.pi, math.pi)))
        try:
            plant.place(*pose)
        except SimulationError:
            continue
        if world.is_known(x, y):
            found.append(pose)
    return found


@given(cells(), st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_the_lidar_sees_the_first_occupied_cell_on_each_beam(each: Cells, seed: int) -> None:
    lidar = Lidar(EXACT, world_of(each), np.random.default_rng(1))
    rng = np.random.default_rng(seed)
    size = max(each.occupied.shape) * each.side_m
    x, y = (np.array(each.origin[:2]) + rng.uniform(-size, size, 2)).tolist()
    heading = float(rng.uniform(-4, 4))
    at = x + 0.1 * math.cos(heading), y + 0.1 * math.sin(heading)
    if each.is_occupied(np.array([at]))[0]:
        return
    expected = [ray_range(each, *at, heading + angle) for angle in lidar.angles_rad]
    seen = [value if 0.05 <= value <= 12.0 else math.inf for value in expected]
    assert lidar.scan(x, y, heading) == pytest.approx(seen, rel=1e-6, abs=1e-9)


def test_a_sonar_hears_a_flat_wall_of_cells_and_a_corner_between_them(tmp_path: Path) -> None:
    hall = "\n".join(["#" * 40, *["#" + "." * 38 + "#"] * 38, "#" * 40])
    world = room_world(tmp_path, drawing=hall, side_m=0.1, origin=(0.0, 0.0, 0.0))
    config = robot(QUIET, {"simulation.sonar.max_incidence_deg": 20.0})
    ring = SonarRing(config, world, np.random.default_rng(1))
    ahead = next(k for k, mount in enumerate(config.sonar) if abs(mount.heading_rad) < 1e-9)
    mount = config.sonar[ahead]
    wall = ring.fire(ahead // 4, 3.0, 2.0, 0.0)[ahead % 4]
    assert wall == pytest.approx(3.9 - 3.0 - mount.x_m, abs=2e-3)
    # Both walls of the corner are met at 32 degrees and more, too flat for an echo of their own.
    corner = ring.fire(ahead // 4, 3.3, 3.3, math.radians(45.0))[ahead % 4]
    away = math.hypot(0.6, 0.6) - mount.x_m
    assert corner == pytest.approx(away, abs=0.01)
    deaf = robot(
        QUIET,
        {"simulation.sonar.max_incidence_deg": 20.0, "simulation.sonar.corner_echo": False},
    )
    silent = SonarRing(deaf, world, np.random.default_rng(1))
    assert silent.fire(ahead // 4, 3.3, 3.3, math.radians(45.0))[ahead % 4] == math.inf


class All:
    """In place of `Near`: all rows, wherever the robot is."""

    def __init__(self, rows: np.ndarray) -> None:
        self._rows = rows

    def at(self, _x_m: float, _y_m: float) -> np.ndarray:
        return self._rows


def test_sensors_that_try_only_what_is_near_measure_what_all_walls_give() -> None:
    rng = np.random.default_rng(7)
    begins = rng.uniform(-40.0, 40.0, (1500, 2))
    segments = np.hstack([begins, begins + rng.normal(0.0, 1.0, (1500, 2))])
    loose = World.from_segments(segments)
    config = robot({"simulation.sonar.crosstalk_probability": 0.9})
    near, all_of = (SonarRing(config, loose, np.random.default_rng(3)) for _ in range(2))
    all_of._walls, all_of._corners = All(loose.segments), All(loose.corners)  # type: ignore[assignment]
    lidar = Lidar(EXACT, loose, np.random.default_rng(3))
    ranges, hits = np.empty(72), np.empty(72, np.int32)
    heard = 0
    for x, y, theta in rng.uniform((-38, -38, -4), (38, 38, 4), (300, 3)).tolist():
        for group in range(near.groups):
            echoes = near.fire(group, x, y, theta)
            np.testing.assert_array_equal(echoes, all_of.fire(group, x, y, theta))
            heard += np.count_nonzero(np.isfinite(echoes))
        axis, at = (
            theta + math.radians(20.0),
            (x + 0.1 * math.cos(theta), y + 0.1 * math.sin(theta)),
        )
        cast_fan(*at, axis, lidar._angles, 12.0, loose.segments, ranges, hits)
        ranges[ranges < 0.05] = np.inf
        np.testing.assert_array_equal(lidar.scan(x, y, theta), ranges)
    assert heard > 1000


@pytest.mark.parametrize("origin", [(-1.0, 2.0, 0.0), ANGLED])
def test_the_camera_sees_the_cells_where_they_are(
    tmp_path: Path, origin: tuple[float, float, float]
) -> None:
    world = room_world(tmp_path, origin=origin)
    camera = Camera(robot(CLEAN), world)
    for pose in free_poses(world, 6, 2):
        view = camera.look(*pose)
        pixels = camera._pixels
        heading = pose[2] + math.radians(camera.mount.yaw_deg)
        c, s = math.cos(pose[2]), math.sin(pose[2])
        at = (
            pose[0] + c * camera.mount.x_m - s * camera.mount.y_m,
            pose[1] + s * camera.mount.x_m + c * camera.mount.y_m,
        )
        for v, u in np.random.default_rng(5).integers((0, 0), view.labels.shape, (60, 2)):
            ray = pixels[v, u]
            bearing = heading + math.atan2(ray["left"], ray["ahead"])
            wall = ray_range(known_cells(world), *at, bearing)
            over = camera.mount.z_m + float(ray["slope"]) * wall > 2.5
            floor = float(ray["floor"])
            label = -1 if floor < wall else -2 if over else 0
            if abs(floor - wall) > 0.01 and not over:
                assert view.labels[v, u] == label
                assert view.distances[v, u] == pytest.approx(min(floor, wall), rel=1e-4)
        angles = np.linspace(-0.5, 0.5, 30)
        truth = [ray_range(known_cells(world), *at, pose[2] + angle) for angle in angles]
        assert true_ranges(world, pose, camera.mount, angles) == pytest.approx(truth, rel=1e-6)


@cache
def body() -> tuple[tuple[float, float], ...]:
    return robot().simulation.body


def depth_in(each: Cells, plant: Plant, inset_m: float) -> bool:
    """Whether the body, smaller by an inset all around, is in an occupied cell."""
    corners = np.array(body())
    corners = corners - np.sign(corners - corners.mean(axis=0)) * inset_m
    share = np.linspace(0.0, 1.0, 60)[:, None]
    sides = [
        a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    points = np.concatenate(sides)
    c, s = math.cos(plant.theta_rad), math.sin(plant.theta_rad)
    placed = points @ np.array([[c, s], [-s, c]]) + (plant.x_m, plant.y_m)
    return bool(each.is_occupied(placed).any())


@pytest.mark.parametrize("side_m", [0.25, 0.1])
@pytest.mark.parametrize("origin", [(-1.0, 2.0, 0.0), ANGLED])
def test_a_robot_that_wanders_never_gets_into_a_cell(
    tmp_path: Path, side_m: float, origin: tuple[float, float, float]
) -> None:
    world = room_world(tmp_path, side_m=side_m, origin=origin)
    rng = np.random.default_rng(11)
    plant = Plant(robot(), world, rng)
    met = 0
    for pose in free_poses(world, 12, 3):
        plant.place(*pose)
        before = plant.collisions
        for _ in range(2):
            left, right = rng.uniform(0.3, 1.0, 2) * rng.choice([-1.0, 1.0])
            command(plant, left, right)
            for _ in range(20):
                plant.step(50)
                assert not depth_in(known_cells(world), plant, 0.002)
        met += plant.collisions > before
    assert met > 6


def test_the_oracle_notices_a_body_in_a_cell(tmp_path: Path) -> None:
    world = room_world(tmp_path)
    plant = Plant(robot(), World.from_segments([]), np.random.default_rng(1))
    wall_x = -1.0 + 0.25  # the left wall's inner side
    for gap, inside in ((0.19, False), (0.178, True)):
        plant.place(wall_x + gap, 4.0, math.pi)  # its front is 0.185 m ahead
        assert depth_in(known_cells(world), plant, 0.002) == inside


def test_who_is_carried_is_put_into_a_free_cell(tmp_path: Path) -> None:
    rows = ["#" * 13, *["#.....#     #"] * 5, "#" * 13]
    world = room_world(tmp_path, drawing="\n".join(rows))
    path = tmp_path / "carried.toml"
    path.write_text('[[fault]]\nkind = "carried"\nat = 0.001\n')
    for seed in range(8):
        simulation = Simulation(DIFF, world, seed)
        play(load_scenario(path, simulation.config), simulation.faults, lambda _: None)
        simulation.advance(10_000_000)
        assert simulation.pose() != world.start
        column, row = in_cells(known_cells(world), *simulation.pose()[:2])
        assert known_cells(world).free[int(row), int(column)]


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ((1.125, 2.875, 0.0), "a wall is in the way; the nearest place"),
        ((-0.6, 3.0, 0.0), "a wall is in the way; the nearest place"),
        (
            (20.0, 3.0, 0.0),
            "lies outside room: allowed are x -0.75..3.75 m, .*; the nearest",
        ),
    ],
)
def test_a_start_where_the_robot_cannot_stand_is_refused_with_the_nearest_place(
    tmp_path: Path, start: tuple[float, float, float], said: str
) -> None:
    world = room_world(tmp_path)
    with pytest.raises(SimulationError, match=said) as error:
        Simulation(DIFF, world, 1, start)
    words = str(error.value).split()
    place = float(words[words.index("is", len(words) - 8) + 2]), float(words[-2])
    simulation = Simulation(DIFF, world, 1, (*place, start[2]))
    assert simulation.pose()[:2] == place
    assert math.dist(place, start[:2]) < 1.0 or start[0] == 20.0


def test_it_starts_where_there_is_the_most_room(tmp_path: Path) -> None:
    world = room_world(tmp_path)
    assert Simulation(DIFF, world, 1).pose() == world.start
    assert known_cells(world).is_free(np.array([world.start[:2]]))[0]


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_simulator_and_robot_read_the_same_cells(
    tmp_path: Path, mode: str, negate: int, channels: int
) -> None:
    from PIL import Image

    rng = np.random.default_rng(channels)
    shape = (9, 14) if channels == 1 else (9, 14, channels)
    pixels = rng.integers(0, 256, shape, dtype=np.uint8)
    pixels[::2, ::3] //= 3
    if channels in {2, 4}:
        pixels[:, ::2, -1] = 255
    Image.fromarray(pixels).save(tmp_path / "room.png")
    path = tmp_path / "room.yaml"
    path.write_text(
        f"image: room.png\nresolution: 5e-2\norigin: [1e-05, '-2', -.5]\nmode: {mode}\n"
        f"negate: {negate}\noccupied_thresh: 0.7\nfree_thresh: 3e-1\n"
    )
    simulated, known = load_cells(path), load_map(path)
    np.testing.assert_array_equal(simulated.occupied, known.occupied())
    np.testing.assert_array_equal(simulated.free, known.free())
    assert simulated.occupied.any()
    assert simulated.side_m == known.resolution_m
    origin = known.origin
    assert simulated.origin == (origin.x_m, origin.y_m, origin.theta_rad)


@pytest.mark.recordings("maps/tb3_sandbox.yaml", "maps/warehouse.yaml")
@pytest.mark.parametrize("name", ["tb3_sandbox", "warehouse"])
def test_maps_of_nav2_are_the_same_for_simulator_and_robot(recordings: Path, name: str) -> None:
    path = recordings / "maps" / f"{name}.yaml"
    simulated, known = load_cells(path), load_map(path)
    np.testing.assert_array_equal(simulated.occupied, known.occupied())
    np.testing.assert_array_equal(simulated.free, known.free())


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"resolution": "0"}, "resolution: must be above 0 m, found 0"),
        ({"resolution": "fine"}, "resolution: must be a finite number, found fine"),
        ({"resolution": ""}, "resolution: must be a finite number, found "),
        ({"origin": "[0, 0]"}, r"origin: must be \[x, y, yaw\], found \['0', '0'\]"),
        ({"origin": "[0, 0, .inf]"}, "origin: must be a finite number, found .inf"),
        ({"origin": "[900, 0, 0]"}, "origin and size: has a coordinate of 905 m; allowed are 500"),
        ({"mode": "binary"}, "mode must be trinary, scale or raw"),
        ({"negate": "2"}, "negate 0 or 1; found trinary, 2"),
        ({"image": "other.png"}, "other.png: .*No such file"),
        ({"image": "room.yaml"}, "room.yaml: cannot identify image file"),
        ({"negate": 1, "free_thresh": 0.0}, "no cell is free, so there is no place for a robot"),
    ],
)
def test_what_is_wrong_with_a_map_is_said(
    tmp_path: Path, keys: dict[str, object], said: str
) -> None:
    with pytest.raises(SimulationError, match=f"room.yaml: .*{said}"):
        load_world(room_map(tmp_path, **keys))  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["", "words", "a: [", "- 1"])
def test_what_is_no_map_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.yml"
    path.write_text(text)
    with pytest.raises(SimulationError, match=r"bad\.yml: "):
        load_world(path)
