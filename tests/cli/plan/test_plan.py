"""`robotctl plan` as a user calls it."""

import csv
import gzip
import json
import math

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.config.robot_file import find_file
from robotctl.errors import ConfigError
from robotctl.planning.path.global_planning.plan import Plan
from robotctl.planning.path.global_planning.planners import PLANNERS

FLAT = ("--map", "flat", "--start", "1,1,0", "--goal", "6,3,90")


def call(*words):
    return CliRunner().invoke(app, ["plan", *map(str, words)])


@pytest.mark.parametrize("planner", ["astar", "dijkstra"])
def test_a_path_through_the_flat_with_all_its_files(tmp_path, planner):
    files = {name: tmp_path / f"p.{name}" for name in ("csv", "png", "json")}
    result = call(
        *FLAT, "--planner", planner,
        "--out", files["csv"], "--plot", files["png"], "--report", files["json"],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    report = json.loads(files["json"].read_text())
    assert report["found"] is True
    assert report["reason"] == ""
    assert math.dist((1, 1), (6, 3)) <= report["length_m"] <= report["cost"] + 0.1
    assert 0.02 < report["min_clearance_m"] < 0.5
    assert report["expanded"] > 100
    rows = list(csv.DictReader(files["csv"].read_text().splitlines()))
    assert [float(each) for each in rows[0].values()] == [1.0, 1.0, 0.0]
    assert [float(each) for each in rows[-1].values()] == [6.0, 3.0, 90.0]
    assert files["png"].stat().st_size > 10_000
    assert f"{planner}: {report['length_m']:.3f} m" in result.output


def test_trees_drive_a_robot_that_steers_on_curves_and_not_in_reverse_if_told_so(tmp_path):
    path = tmp_path / "p.csv"
    for more in ((), ("--steering", "dubins")):
        result = call(
            *FLAT, "--planner", "rrt-connect", "--robot", "ackermann", "--out", path, *more
        )
        assert result.exit_code == 0, result.output
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        assert rows[-1] == pytest.approx((6.0, 3.0, 90.0), abs=1e-3)
        chords = np.hypot(*np.diff(rows[:, :2], axis=0).T)
        turns = np.abs((np.radians(np.diff(rows[:, 2])) + math.pi) % math.tau - math.pi)
        assert (turns <= 1.001 * chords / 0.497 + 1e-4).all(), "its smallest circle"


class Tireless:
    """A planner that goes on for as long as it may, as one that makes its path ever better."""

    def __init__(self, config):
        del config

    def plan(self, space, start, goal, goes_on):
        """Return the straight path when it may not go on any more."""
        del space
        while goes_on():
            pass
        poses = np.array([(each.x_m, each.y_m, each.theta_rad) for each in (start, goal)])
        return Plan(poses, math.dist(*poses[:, :2]), 0)


def test_a_planner_that_never_ends_by_itself_is_given_its_time_alone(monkeypatch):
    monkeypatch.setitem(PLANNERS, "tireless", Tireless)
    result = call(*FLAT, "--planner", "tireless", "--time-limit", 0.01)
    assert result.exit_code == 0, result.output
    assert "tireless: 5.385 m" in result.output


def test_the_zones_of_the_robot_are_kept_out_of():
    zone = "navigation.pilot.zone=[{name = 'door', corners = [[4.5, 1.5], [5.5, 1.5], [5, 3.5]]}]"
    result = call(*FLAT, "--set", zone)
    assert result.exit_code == 1, result.output
    assert "closed all around, at x 5" in result.output
    assert "by the keep-out zone door" in result.output


def test_the_masks_of_the_robot_are_kept_out_of_and_found_beside_its_file(tmp_path):
    pixels = np.full((50, 80), 254, np.uint8)
    pixels[20:30, 45:55] = 0  # of the flat, in cells of 0.1 m: the door is there
    assert cv2.imwrite(str(tmp_path / "keep.png"), pixels)
    head = "image: keep.png\nresolution: 0.1\norigin: [0, 0, 0]\n"
    rest = "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"
    (tmp_path / "keep.yaml").write_text(head + rest)
    robot = tmp_path / "robot.toml"
    mask = '[[navigation.pilot.mask]]\nfile = "keep.yaml"\nkind = "keep_out"\n'
    robot.write_text(f"{find_file('diff_drive').read_text()}\n{mask}")
    assert call(*FLAT).exit_code == 0
    result = call(*FLAT, "--robot", robot)
    assert result.exit_code == 1, result.output
    assert "by the keep-out mask keep.yaml" in result.output
    robot.write_text(robot.read_text().replace('"keep.yaml"', '"kept.yaml"'))
    result = call(*FLAT, "--robot", robot)
    assert isinstance(result.exception, ConfigError)
    assert "kept.yaml: No such file" in str(result.exception)


@pytest.mark.parametrize("planner", ["astar", "dijkstra", "hybrid"])
@pytest.mark.parametrize(("value", "longer"), [(0, False), (15, False), (90, True)])
def test_a_band_of_a_mask_is_passed_by_where_that_is_cheaper(planner, value, longer, tmp_path):
    """Straight on the robot crosses 2 m of a band; round it the way is about 1.5 m longer."""
    cells = np.full((80, 120), 254, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 0
    band = np.full((80, 120), 255, np.uint8)
    band[20:, 50:70] = 255 - round(2.55 * value)
    rest = "resolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
    trinary = "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    for name, pixels, mode in (
        ("hall", cells, trinary),
        ("lane", band, "mode: scale\noccupied_thresh: 1.0\nfree_thresh: 0.0\n"),
    ):
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), pixels)
        (tmp_path / f"{name}.yaml").write_text(f"image: {name}.png\n{rest}{mode}")
    robot = tmp_path / "robot.toml"
    mask = '[[navigation.pilot.mask]]\nfile = "lane.yaml"\nkind = "keep_out"\n'
    robot.write_text(f"{find_file('diff_drive').read_text()}\n{mask}")
    report, out = tmp_path / "r.json", tmp_path / "p.csv"
    result = call(
        *("--map", tmp_path / "hall.yaml", "--start", "2,4", "--goal", "10,4", "--robot", robot),
        *("--planner", planner, "--report", report, "--out", out),
    )
    assert result.exit_code == 0, result.output
    x, y = np.loadtxt(out, delimiter=",", skiprows=1, usecols=(0, 1)).T
    points = np.column_stack([np.interp(np.linspace(0, 1, 500), np.linspace(0, 1, len(x)), each)
                              for each in (x, y)])  # fmt: skip
    inside = (points[:, 0] > 5.2) & (points[:, 0] < 6.8) & (points[:, 1] < 5.8)
    assert inside.any() != longer


def test_a_mask_of_no_kind_is_refused_and_what_there_is_is_told(tmp_path):
    robot = tmp_path / "robot.toml"
    mask = '[[navigation.pilot.mask]]\nfile = "lane.yaml"\nkind = "lane"\n'
    robot.write_text(f"{find_file('diff_drive').read_text()}\n{mask}")
    result = call(*FLAT, "--robot", robot)
    assert isinstance(result.exception, ConfigError)
    assert "'keep_out', 'speed_percent', 'speed_m_s' or 'binary'" in str(result.exception)


def test_a_goal_in_a_wall_is_told_and_the_status_is_1(tmp_path):
    report = tmp_path / "r.json"
    result = call("--map", "flat", "--start", "1,1", "--goal", "0,2", "--report", report)
    assert result.exit_code == 1
    assert "no path: the goal at x 0.00 m, y 2.00 m" in result.output
    figures = json.loads(report.read_text())
    assert (figures["found"], figures["code"], figures["length_m"]) == (False, "goal_blocked", None)
    assert "the nearest place with room for it is" in figures["reason"]


@pytest.fixture
def moving_ai(tmp_path):
    """A map with a wall in which one cell is open; the top row is all free."""
    rows = ["........", "...@....", "...@....", "...@....", "...@...."]
    path = tmp_path / "wall.map"
    path.write_text("\n".join(["type octile", "height 5", "width 8", "map", *rows]) + "\n")
    return path


def test_cells_of_a_moving_ai_map_are_counted_from_the_top_left(moving_ai, tmp_path):
    out, report = tmp_path / "p.csv", tmp_path / "r.json"
    words = (
        "--map",
        moving_ai,
        "--start",
        "2,3",
        "--goal",
        "4,3",
        "--out",
        out,
        "--report",
        report,
    )
    assert call(*words).exit_code == 0
    # Up three, two to the right without cutting corners, down three.
    assert json.loads(report.read_text())["length_m"] == pytest.approx(8.0)
    rows = csv.DictReader(out.read_text().splitlines())
    cells = [(float(row["column"]), float(row["row"])) for row in rows]
    assert (cells[0], cells[-1]) == ((2.0, 3.0), (4.0, 3.0))
    assert (3.0, 0.0) in cells


def test_a_cell_in_a_wall_of_a_moving_ai_map(moving_ai):
    result = call("--map", moving_ai, "--start", "2,3", "--goal", "3,1")
    assert result.exit_code == 1
    assert "lies in an obstacle" in result.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*FLAT[:4], "--goal", "6"), "--goal 6: two or three numbers"),
        ((*FLAT, "--planner", "a-star"), 'there is no such planner; did you mean "astar"?'),
        ((*FLAT, "--steering", "dubin"), "--steering dubin: straight, dubins, reeds-shepp are"),
        (
            ("--map", "{map}", "--start", "2,3", "--goal", "4,3", "--steering", "dubins"),
            "--steering dubins: on a MovingAI map",
        ),
        ((*FLAT, "--time-limit", "0"), "--time-limit 0"),
        ((*FLAT[:4], "--goal", "nan,1"), "--goal nan,1: two or three numbers"),
        ((*FLAT, "--report", "/nowhere/r.json"), "the folder /nowhere does not exist"),
        (("--map", "flut", *FLAT[2:]), 'did you mean "flat"'),
        (("--map", "{map}", "--start", "1.5,2", "--goal", "1,2"), "column,row from the top left"),
    ],
)  # fmt: skip
def test_wrong_words_are_told(moving_ai, words, said):
    result = call(*(str(word).format(map=moving_ai) for word in words))
    assert isinstance(result.exception, ConfigError), result.output
    assert said in str(result.exception)


@pytest.mark.recordings("movingai")
def test_published_lengths_come_out_of_the_command(recordings, tmp_path):
    lines = gzip.decompress((recordings / "movingai" / "arena.map.scen.gz").read_bytes())
    problems = [line.split("\t") for line in lines.decode().splitlines()[1:]]
    for words in problems[:: len(problems) // 4]:
        report = tmp_path / "r.json"
        x0, y0, x1, y1 = words[4:8]
        result = call(
            "--map", recordings / "movingai" / "arena.map.gz",
            "--start", f"{x0},{y0}", "--goal", f"{x1},{y1}", "--report", report,
        )  # fmt: skip
        assert result.exit_code == 0, result.output
        assert json.loads(report.read_text())["length_m"] == pytest.approx(
            float(words[8]), abs=1e-3
        )


@pytest.mark.recordings("maps")
def test_the_warehouse_is_crossed_and_the_heading_at_the_goal_is_as_asked(recordings, tmp_path):
    out = tmp_path / "p.csv"
    world_map = recordings / "maps" / "warehouse.yaml"
    result = call("--map", world_map, "--start", "0,0", "--goal", "10,15,45", "--out", out)
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [float(each) for each in rows[-1].values()] == [10.0, 15.0, 45.0]


@pytest.fixture
def bare(tmp_path):
    """A map of 5 m without an obstacle."""
    (tmp_path / "bare.pgm").write_bytes(b"P5\n100 100\n255\n" + bytes([254]) * 10_000)
    file = tmp_path / "bare.yaml"
    file.write_text(
        "image: bare.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.1\n"
    )
    return file


def tape(speed_m_s):
    corners = "[[2.0, -1], [2.02, -1], [2.02, 7], [2.0, 7]]"
    return f"navigation.pilot.zone=[{{name='tape', corners={corners}, speed_m_s={speed_m_s}}}]"


def test_a_map_without_an_obstacle_has_straight_paths(bare, tmp_path):
    report = tmp_path / "r.json"
    result = call("--map", bare, "--start", "1,1,0", "--goal", "4,4", "--report", report)
    assert result.exit_code == 0, result.output
    assert json.loads(report.read_text())["length_m"] == pytest.approx(math.hypot(3, 3), abs=1e-6)


@pytest.mark.parametrize("planner", ["astar", "hybrid", "rrt"])
def test_a_tape_thinner_than_a_cell_keeps_the_robot_out(bare, planner):
    ends = ("--map", bare, "--start", "1,1,0", "--goal", "4,1,0")
    result = call(*ends, "--planner", planner, "--set", tape(0), "--time-limit", 3)
    assert result.exit_code == 1, result.output
    assert "by the keep-out zone tape" in " ".join(result.output.split())


def test_the_cost_tells_that_a_slow_tape_is_crossed(bare, tmp_path):
    costs = []
    for speed_m_s in (0.8, 0.1):
        report = tmp_path / "r.json"
        ends = ("--map", bare, "--start", "1,1,0", "--goal", "4,1,0")
        result = call(*ends, "--report", report, "--set", tape(speed_m_s))
        assert result.exit_code == 0, result.output
        costs.append(json.loads(report.read_text())["cost"])
    # The tape touches two columns of 5 cm, which take eight times as long.
    assert costs[1] - costs[0] == pytest.approx(0.1 * 7, abs=0.06)


def test_a_start_at_the_edge_of_the_map_is_told(bare):
    result = call("--map", bare, "--start", "0,0,0", "--goal", "4,4")
    assert result.exit_code == 1
    assert "from the edge of the map at x 0.00 m, y 0.00 m" in " ".join(result.output.split())
