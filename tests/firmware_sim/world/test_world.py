"""Worlds: the files that come with the project, and what is said about wrong ones."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.config.config import load_robot
from firmware_sim.config.parameters import LidarParameters
from firmware_sim.errors import SimulationError
from firmware_sim.plant.plant import Plant
from firmware_sim.sensors.lidar import Lidar
from firmware_sim.simulation import Simulation
from firmware_sim.world.shapes import Box, Pillar
from firmware_sim.world.world import World, load_world

CONFIGS = Path(__file__).parents[3] / "configs"
WORLDS = sorted((CONFIGS / "worlds").glob("*.toml"))


def test_the_promised_worlds_are_there() -> None:
    names = {path.stem for path in WORLDS}
    assert {"empty_room", "flat", "corridor_loop", "office"} <= names
    assert all(load_world(path).name == path.stem for path in WORLDS)


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.stem)
@pytest.mark.parametrize("robot", ["diff_drive", "tricycle", "ackermann"])
def test_every_robot_can_stand_at_every_start(path: Path, robot: str) -> None:
    world = load_world(path)
    p = Plant(load_robot(CONFIGS / f"{robot}.toml"), world, np.random.default_rng(1))
    assert (p.x_m, p.y_m, p.theta_rad) == world.start


def crossings(world: World, a: tuple[float, float], b: tuple[float, float]) -> int:
    """How many walls a straight way crosses."""
    count = 0
    for px, py, qx, qy in world.segments:
        area = (b[0] - a[0]) * (qy - py) - (b[1] - a[1]) * (qx - px)
        if area != 0:
            t = ((px - a[0]) * (qy - py) - (py - a[1]) * (qx - px)) / area
            u = ((px - a[0]) * (b[1] - a[1]) - (py - a[1]) * (b[0] - a[0])) / area
            count += 0 < t < 1 and 0 <= u <= 1
    return count


def test_the_flat_has_two_rooms_a_door_and_its_furniture() -> None:
    flat = load_world(CONFIGS / "worlds" / "flat.toml")
    assert flat.bounds == (0.0, 0.0, 8.0, 5.0)
    assert flat.start == (1.0, 1.0, 0.0)
    for y in (2.01, 2.5, 2.99):
        assert crossings(flat, (4.0, y), (6.0, y)) == 0
    for y in (0.5, 1.99, 3.01, 4.5):
        assert crossings(flat, (4.0, y), (6.0, y)) == 2
        assert crossings(flat, (4.94, y), (4.96, y)) == 1
        assert crossings(flat, (5.04, y), (5.06, y)) == 1
    assert flat.solid_at(0.3, 4.5) == "cabinet"
    assert flat.solid_at(0.61, 4.5) == flat.solid_at(0.3, 3.89) == ""
    assert flat.solid_at(7.21, 0.79) == "table"
    assert flat.solid_at(7.19, 0.4) == flat.solid_at(7.6, 0.81) == ""
    assert flat.solid_at(5.0, 1.0).startswith("inner")


def test_the_corridor_is_a_loop_two_metres_wide_and_the_office_is_long() -> None:
    loop = load_world(CONFIGS / "worlds" / "corridor_loop.toml")
    ring = [(1.0, 1.0), (11.0, 1.0), (11.0, 3.0), (11.0, 7.0), (1.0, 7.0), (1.0, 1.0)]
    assert all(crossings(loop, a, b) == 0 for a, b in itertools.pairwise(ring))
    assert crossings(loop, (6.0, 0.5), (6.0, 2.5)) == 1
    office = load_world(CONFIGS / "worlds" / "office.toml")
    assert office.bounds[2] - office.bounds[0] >= 30.0
    assert crossings(office, (1.0, 7.5), (33.0, 7.5)) == 0
    assert len(office.solids) > 40


def test_every_room_of_the_office_can_be_reached_by_a_robot_of_half_a_metre() -> None:
    office = load_world(CONFIGS / "worlds" / "office.toml")
    step, clear = 0.1, 0.25
    nx, ny = round(34 / step), round(15 / step)
    xs, ys = (np.arange(nx) + 0.5) * step, (np.arange(ny) + 0.5) * step
    grid = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1)
    free = np.ones((nx, ny), dtype=bool)
    for ax, ay, bx, by in office.segments:
        d = np.array([bx - ax, by - ay])
        t = np.clip(((grid - (ax, ay)) @ d) / (d @ d), 0, 1)
        free &= np.hypot(*np.moveaxis(grid - (ax, ay) - t[..., None] * d, -1, 0)) > clear
    reached = np.zeros_like(free)
    front = [(round(1.5 / step), round(7.5 / step))]
    while front:
        i, j = front.pop()
        if 0 <= i < nx and 0 <= j < ny and free[i, j] and not reached[i, j]:
            reached[i, j] = True
            front += [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
    south = [(3, 4), (8.5, 5), (14, 4.5), (19.5, 5), (24, 5)]
    north = [(2.5, 10), (9, 9.8), (14.1, 10.5), (22, 11), (31, 8), (32, 2)]
    for x, y in [*south, *north]:
        assert reached[round(x / step), round(y / step)], (x, y)


@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(0.1, 3), st.floats(0.1, 3), st.floats(-180, 180)
)
def test_a_turned_box_has_its_size_and_four_inner_corners_for_who_is_inside(
    x: float, y: float, width: float, depth: float, heading: float
) -> None:
    chain = np.array(Box((x, y), (width, depth), heading).outlines()[0])
    sides = np.hypot(*np.diff(chain, axis=0).T)
    assert sides == pytest.approx([width, depth, width, depth])
    assert chain[:-1].mean(axis=0) == pytest.approx([x, y], abs=1e-9)
    corners = World.from_segments(np.hstack([chain[:-1], chain[1:]])).corners
    assert len(corners) == 4
    for cx, cy, ux, uy, vx, vy in corners:
        assert ux * vx + uy * vy == pytest.approx(0.0, abs=1e-9)
        # Both arms point along the box, so the middle is between them.
        assert (x - cx) * ux + (y - cy) * uy > 0
        assert (x - cx) * vx + (y - cy) * vy > 0


def test_a_wall_that_ends_at_another_makes_two_corners() -> None:
    world = World.from_segments([(0.0, 0.0, 4.0, 0.0), (2.0, 0.0, 2.0, 3.0)])
    assert len(world.corners) == 2
    assert {tuple(np.round(c[:2], 9)) for c in world.corners} == {(2.0, 0.0)}
    assert sorted(round(c[4], 9) for c in world.corners) == [-1.0, 1.0]


def test_a_pillar_is_no_smaller_than_its_circle() -> None:
    chain = np.array(Pillar("pillar", (1.0, 2.0), 0.3).outlines()[0])
    middles = (chain[:-1] + chain[1:]) / 2
    assert np.hypot(middles[:, 0] - 1.0, middles[:, 1] - 2.0) == pytest.approx(0.3)


HEAD = '[world]\nname = "w"\nstart = { x_m = 0.0, y_m = 0.0 }\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[world\n", "w.toml: "),
        ('[world]\nname = "w"\n', "world.start: missing"),
        (HEAD + "[[wal]]\npoints = []\n", "wal: unknown key; did you mean"),
        (HEAD + "[[wall]]\npoints = [[0.0, 0.0]]\n", "wall.0.points"),
        (HEAD + "[[wall]]\npoints = [[0.0, 1.0], [0.0, 1.0]]\n", "two points coincide"),
        (HEAD + "[[wall]]\npoints = [[0.0, 1.0], [0.0, 1.0]]\nthickness_m = 0.1\n", "coincide"),
        (HEAD + "[[wall]]\npoints = [[5e3, 0.0], [5e3, 1.0]]\n", "wall: has a coordinate of 5000"),
        (HEAD + "[[box]]\ncentre = [3.0, 0.0]\nsize = [1e5, 1.0]\n", "a coordinate of 50003"),
        (HEAD.replace("0.0", "1e4"), "world.start or world.bounds: has a coordinate of 10000 m"),
        (HEAD + "[[wall]]\npoints = [[0.0, 1.0], [1.0, 1.0]]\nthick_m = 1.0\n", "thick_m"),
        (HEAD + '[[wall]]\npoints = [[0.0, "a"], [1.0, 1.0]]\n', "wall.0.points.0.1"),
        (HEAD + "[[box]]\ncentre = [0.0, 0.0]\nsize = [1.0, -1.0]\n", "box.0.size.1"),
        (HEAD + '[[furniture]]\nkind = "pilar"\n', "furniture.0"),
        (HEAD.replace("0.0", "nan"), "world.start.x_m"),
        (HEAD + "bounds = [2.0, -1.0, -2.0, 1.0]\n", "allowed are min x, min y, max x, max y"),
        (HEAD + "[[wall]]\npoints = [[1.0, 1.0], [2.0, 1.0]]\n" , ""),
    ],
)  # fmt: skip
def test_a_wrong_file_is_named_with_its_key(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "w.toml"
    path.write_text(text)
    if not said:
        assert load_world(path).segments.shape == (1, 4)
        return
    with pytest.raises(SimulationError) as error:
        load_world(path)
    assert str(path) in str(error.value)
    assert said in str(error.value)


def test_all_errors_of_a_file_are_reported_at_once(tmp_path: Path) -> None:
    path = tmp_path / "w.toml"
    path.write_text("[world]\nname = 3\n[[box]]\ncentre = [0.0]\nsize = [1.0, 1.0]\n")
    with pytest.raises(SimulationError) as error:
        load_world(path)
    assert len(str(error.value).splitlines()) == 3


def test_a_start_outside_the_bounds_and_a_missing_file_are_errors(tmp_path: Path) -> None:
    path = tmp_path / "w.toml"
    path.write_text(HEAD.replace("start", "bounds = [1.0, 1.0, 2.0, 2.0]\nstart"))
    with pytest.raises(SimulationError, match="outside the bounds"):
        load_world(path)
    with pytest.raises(SimulationError, match="cannot be read"):
        load_world(tmp_path / "none.toml")


THINGS = """
[world]
name = "things"
start = {x_m = 0.0, y_m = 0.0}
[[wall]]
points = [[3.0, -2.0], [3.0, 2.0]]
[[box]]
centre = [2.0, 1.0]
size = [0.2, 0.2]
height_m = 0.05
[[obstacle]]
name = "cup"
centre = [1.0, 0.0]
radius_m = 0.05
height_m = 0.09
[[obstacle]]
name = "bottle"
centre = [1.0, 0.5]
size = [0.1, 0.1]
height_m = 0.3
colour = "#00ff00"
"""


def things(folder: Path, text: str = THINGS) -> World:
    path = folder / "things.toml"
    path.write_text(text, encoding="utf-8")
    return load_world(path)


def test_an_obstacle_is_on_no_map_but_in_the_way(tmp_path: Path) -> None:
    world = things(tmp_path)
    assert len(world.segments) == 1 + 4
    assert len(world.touchable) == 1 + 4 + 16 + 4
    assert world.solid_at(1.0, 0.0) == "cup"
    plant = Plant(load_robot(CONFIGS / "diff_drive.toml"), world, np.random.default_rng(1))
    with pytest.raises(SimulationError, match="cup is in the way"):
        plant.place(1.0, 0.0, 0.0)
    with pytest.raises(SimulationError, match="is in the way"):
        plant.place(0.8, 0.0, 0.0)  # with its front on the cup


def test_a_sensor_sees_what_is_higher_than_it_is_mounted(tmp_path: Path) -> None:
    world = things(tmp_path)
    assert len(world.seen_from(0.04).segments) == 1 + 4 + 16 + 4
    assert len(world.seen_from(0.07).segments) == 1 + 16 + 4
    assert [thing.name for thing in world.seen_from(0.1).things] == ["wall", "bottle"]
    lidar = LidarParameters(beams=3, fov_deg=60.0, sigma_m=0.0, dropout_probability=0.0)
    for z_m, ahead_m in ((0.05, 0.95), (0.2, 3.0)):
        seen = Lidar(lidar, world.seen_from(z_m), np.random.default_rng(1)).scan(0.0, 0.0, 0.0)
        assert seen[1] == pytest.approx(ahead_m, abs=2e-3)


def test_the_robots_lidar_looks_over_low_obstacles(tmp_path: Path) -> None:
    simulation = Simulation(load_robot(CONFIGS / "diff_drive.toml"), things(tmp_path))
    scan = simulation.scan()
    assert scan is not None
    assert np.frombuffer(scan.ranges, "<f4")[180] == pytest.approx(3.0, abs=0.05)


@pytest.mark.parametrize("path", WORLDS, ids=lambda path: path.stem)
def test_sensors_see_worlds_without_obstacles_as_their_maps(path: Path) -> None:
    world = load_world(path)
    if not any(thing.kind == "obstacle" for thing in world.things):
        assert world.seen_from(0.2) is world
        assert np.array_equal(world.touchable, world.segments)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("radius_m = 0.05", "", "an obstacle has either radius_m or size"),
        ("radius_m = 0.05", "radius_m = 0.05\nsize = [1.0, 1.0]", "either radius_m or size"),
        ("height_m = 0.09", "", "obstacle.0.height_m: missing"),
        ("#00ff00", "green", "obstacle.1.colour"),
        ("height_m = 0.3", "heigth_m = 0.3", 'did you mean "height_m"?'),
    ],
)
def test_a_wrong_obstacle_is_told_by_its_key(old: str, new: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=re.escape(said)):
        things(tmp_path, THINGS.replace(old, new))
