"""`robotctl sim` in a ROS map: missions, starts, and maps that are not of the world."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from robotctl.app.localisation.estimators import make_estimators
from robotctl.app.simulation.lockstep import LockstepRun, run_lockstep
from robotctl.app.simulation.room import load_room, straight_mission
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.estimation.grid.wall_raster import grid_of_walls
from robotctl.maps.map_file import load_map, save_map
from robotctl.maps.map_fit import misfit, shares_near
from robotctl.maps.world import find_world, load_walls
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.wall_map import WallMap
from tests.cli.command import status_of
from tests.firmware_sim.world.cell_rooms import room_map

ROBOT = find_file("diff_drive")
DRIVE = """
name = "round"
world = "room.yaml"
start = { x_m = 0.6, y_m = 3.9, heading_deg = 0.0 }
[[item]]
kind = "drive"
waypoints = [[0.6, 3.9], [1.4, 3.9], [1.4, 4.8]]
corner_radius_m = 0.3
"""


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """The map of a room of 5 m by 3.75 m."""
    return room_map(tmp_path, side_m=0.05, times=5)


@pytest.fixture
def mission(tmp_path: Path, room: Path) -> Path:
    """A mission in a file beside its map."""
    path = tmp_path / "round.toml"
    path.write_text(DRIVE)
    return path


def test_a_mission_is_driven_in_the_map_beside_its_file(mission: Path, tmp_path: Path) -> None:
    options = SimOptions(
        ROBOT,
        mission,
        record=tmp_path / "logs",
        localisation=('localisation.method="mcl"', "localisation.mapping=true"),
    )
    (tmp_path / "logs").mkdir()
    notices: list[str] = []
    report = run_lockstep(options, notices.append)
    assert report.mission_completed, report.message
    # A first run on a computer compiles its estimators, and says so.
    others = [notice for notice in notices if not notice.startswith("compiling")]
    assert (report.world, report.collisions, others) == ("room", 0, [])
    assert report.localisation is not None
    assert report.localisation.error.max_m < 0.1
    assert report.map_quality is not None
    assert report.map_quality.precision > 0.95
    # What its lidar mapped, drawn at its own resolution, are the sides of the map's cells.
    seen = load_map(tmp_path / "logs" / "map-0001.yaml")
    drawn = WallMap(load_room(tmp_path / "room.yaml").segments)
    of_map, of_walls = shares_near(seen, drawn)
    assert of_map > 0.99
    assert of_walls > 0.5


@pytest.mark.parametrize("name", ["", "empty_room"])
def test_without_a_mission_the_robot_drives_the_clear_way_of_the_world(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    report = tmp_path / "report.json"
    status = status_of("sim", "--world", name or room, "--lockstep", "--report", report)
    assert status == 0, capsys.readouterr()
    found = json.loads(report.read_text())
    assert (found["mission"], found["collisions"]) == ("straight", 0)
    assert found["world"] == (name or "room")
    assert found["distance_m"] > 0.5


@pytest.mark.parametrize("name", ["empty_room", "hall", "corridor_loop", "office", "clutter"])
def test_the_clear_way_of_a_world_keeps_clear_of_all_that_stands_there(name: str) -> None:
    world = find_file(name, "worlds")
    ((begin, end),) = (item["waypoints"] for item in tomllib.loads(straight_mission(world))["item"])
    begin, end = np.array(begin), np.array(end)
    assert np.hypot(*(end - begin)) > 2.5
    for point in begin + np.linspace(0.0, 1.0, 50)[:, None] * (end - begin):
        ax, ay, bx, by = load_room(world).touchable.T
        d, to = np.array([bx - ax, by - ay]), np.array([point[0] - ax, point[1] - ay])
        foot = np.clip((d * to).sum(axis=0) / (d * d).sum(axis=0), 0.0, 1.0)
        assert np.hypot(*(to - foot * d)).min() > 0.3


def test_the_same_seed_gives_the_same_run_in_a_map(mission: Path) -> None:
    options = SimOptions(ROBOT, mission, localisation=('localisation.method="mcl"',))
    ends = [
        [(state.x_m, state.y_m, state.sonar_m) for state, _ in LockstepRun(options).steps()][-1]
        for _ in range(2)
    ]
    np.testing.assert_array_equal(np.hstack(ends[0]), np.hstack(ends[1]))


def test_too_narrow_a_map_asks_for_a_mission(tmp_path: Path) -> None:
    path = room_map(tmp_path, drawing="#######\n#.....#\n#.....#\n#######", side_m=0.1)
    with pytest.raises(ConfigError, match=r"room\.yaml: too narrow .* give it a --mission"):
        straight_mission(path)


def test_a_start_in_a_wall_is_refused_with_the_nearest_place(
    mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission.write_text(DRIVE.replace("x_m = 0.6", "x_m = -0.8"))
    assert status_of("sim", "--mission", mission, "--lockstep") == 2
    said = capsys.readouterr().err
    assert "the start at x -0.8 m, y 3.9 m lies outside room" in said
    assert "the nearest place for it with this heading is x -0.55 m, y" in said


def test_a_goal_outside_of_the_world_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("sim", "--world", "flat", "--goal", "30,1", "--lockstep") == 2
    said = capsys.readouterr().err
    assert "--goal: x 30 m, y 1 m lies outside flat: allowed are x 0..8 m, y 0..5 m" in said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("room.pgm", "room.pgm: an image; needed is the map's .yaml that names it"),
        ("other.yaml", "other.yaml: no such file"),
    ],
)
def test_a_world_that_is_no_map_is_refused(name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        find_world(name)


def test_a_map_without_a_wall_or_a_free_cell_is_no_world(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"room\.yaml: no walls found"):
        load_room(room_map(tmp_path, drawing="...\n..."))
    with pytest.raises(ConfigError, match=r"room\.yaml: no cell is free"):
        load_room(room_map(tmp_path, drawing="###\n###"))


def moved(grid: GridMap, by_m: float) -> GridMap:
    return GridMap(grid.cells, grid.resolution_m, SE2(grid.origin.x_m + by_m, grid.origin.y_m, 0.0))


def test_a_map_fits_its_world_and_parts_of_it_and_no_other() -> None:
    flat, office = (load_walls(find_file(name, "worlds")) for name in ("flat", "office"))
    grid = grid_of_walls(flat)
    assert shares_near(grid, flat) == (1.0, 1.0)
    half = GridMap(grid.cells[:, : grid.cells.shape[1] // 2].copy(), 0.05, grid.origin)
    of_map, of_walls = shares_near(half, flat)
    assert of_map == 1.0
    assert of_walls < 0.7
    assert max(shares_near(grid, office)) < 0.6
    assert max(shares_near(moved(grid, 100.0), flat)) == 0.0
    assert min(shares_near(moved(grid, 0.2), flat)) == 1.0


def test_the_map_of_another_place_is_said_and_that_of_the_world_is_not(
    mission: Path, room: Path, tmp_path: Path
) -> None:
    flat = find_file("flat", "worlds")
    save_map(tmp_path / "flat", grid_of_walls(load_walls(flat)))
    walls = load_walls(flat)
    for name, fits in ((flat, True), (tmp_path / "flat.yaml", True), (room, False)):
        settings = (f'localisation.map="{name}"', 'localisation.method="mcl"')
        said = misfit(load_robot(ROBOT, settings), ROBOT, flat, walls)
        assert (said == "") == fits
        if not fits:
            assert f"the map {room} does not fit the world flat.toml" in said
    assert misfit(load_robot(ROBOT), ROBOT, flat, walls) == ""


def test_a_run_with_the_map_of_another_place_says_so(
    mission: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    localiser = ("--localiser", "mcl", "--map", "office", "--max-seconds", "1")
    assert status_of("sim", "--mission", mission, "--lockstep", *localiser) == 3
    said = capsys.readouterr().err
    assert "office.toml does not fit the world room.yaml: " in said
    assert "% of the world's walls an obstacle of the map" in said


@pytest.mark.parametrize("method", ["mcl", "ekf"])
@pytest.mark.parametrize(
    ("start", "said"),
    [
        (SE2(1.0, 1.0), ""),
        (SE2(50.0, 1.0), "at x 50 m, y 1 m lies off the map, which has x -0.05 to 8.10 m and y -0"),
        (SE2(8.0, 2.0), "at x 8 m, y 2 m lies in a wall of the map"),
    ],
)
def test_a_start_off_the_map_is_said(method: str, start: SE2, said: str) -> None:
    settings = ('localisation.map="flat"', f'localisation.method="{method}"')
    news = make_estimators(load_robot(ROBOT, settings), start, Path()).take_notices()
    assert len(news) == bool(said)
    assert all(said in each for each in news)


def test_so_is_a_start_where_the_map_knows_nothing_but_no_unknown_start(room: Path) -> None:
    room.with_name("room.pgm").write_bytes(b"P5\n4 4\n255\n" + bytes([0, 254, 205, 205] * 4))
    settings = (f'localisation.map="{room}"', 'localisation.method="mcl"')
    start = SE2(-0.88, 2.1)
    (said,) = make_estimators(load_robot(ROBOT, settings), start, Path()).take_notices()
    assert "lies in an unknown part of the map: is it the right map?" in said
    unknown = (*settings, 'localisation.start="unknown"')
    assert make_estimators(load_robot(ROBOT, unknown), start, Path()).take_notices() == []


TOUR = {
    "tb3_sandbox": [[-0.55, -0.55], [0.55, -0.55], [0.55, 0.55], [-0.55, 0.55], [-0.55, -0.55]],
    "warehouse": [[-3.1, 3.1], [-5.2, 3.1], [-4.6, -3.0]],
}


@pytest.mark.recordings("maps/tb3_sandbox.yaml", "maps/warehouse.yaml")
@pytest.mark.parametrize(
    ("robot", "name"), [("diff_drive", "tb3_sandbox"), ("tricycle", "warehouse")]
)
def test_a_robot_drives_and_localises_in_a_map_of_nav2(
    recordings: Path, tmp_path: Path, name: str, robot: str
) -> None:
    points = TOUR[name]
    (ax, ay), (bx, by) = points[:2]
    heading = math.degrees(math.atan2(by - ay, bx - ax))
    mission = tmp_path / "tour.toml"
    radius = 0.2 if robot == "diff_drive" else 0.5
    mission.write_text(
        f'name = "tour"\nworld = "{recordings}/maps/{name}.yaml"\n'
        f"start = {{ x_m = {ax}, y_m = {ay}, heading_deg = {heading} }}\n"
        f'[[item]]\nkind = "drive"\nwaypoints = {points}\ncorner_radius_m = {radius}\n'
    )
    options = SimOptions(
        find_file(robot),
        mission,
        localisation=('localisation.method="mcl"',),
    )
    report = run_lockstep(options)
    assert report.mission_completed, report.message
    assert (report.collisions, report.unsafe_motions) == (0, 0)
    assert report.localisation is not None
    # The tricycle has sonars alone, and hears few walls in a hall.
    assert report.localisation.error.max_m < (0.15 if robot == "diff_drive" else 0.4)
