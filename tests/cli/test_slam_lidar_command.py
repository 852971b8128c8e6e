"""`robotctl slam --sensor lidar`: a CARMEN log becomes a trajectory, a map and a graph."""

import json

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import RobotctlError
from robotctl.maps.map_file import load_map
from tests.estimation.slam.lidar_world import along, box, drifting, scan_of

WALLS = np.concatenate([box(-2.0, -2.0, 8.0, 5.0), box(2.0, 1.0, 0.5, 0.5)])


def run(*words):
    return CliRunner().invoke(app, ["slam", "--sensor", "lidar", *map(str, words)])


def written(file, corners, change=lambda ranges: ranges):
    """Write a raw CARMEN log of a drive through a room, each scan changed by something."""
    rng = np.random.default_rng(0)
    poses = along(corners)
    rows = []
    for number, (pose, odometry) in enumerate(zip(poses, drifting(poses, rng), strict=True)):
        ranges = change(scan_of(WALLS, pose, rng).ranges_m)
        words = " ".join(f"{each:.3f}" for each in ranges)
        place = f"{odometry.x_m:.6f} {odometry.y_m:.6f} {odometry.theta_rad:.6f}"
        time = f"{1000.0 + 0.4 * number:.6f}"
        rows.append(f"ODOM {place} 0 0 0 {time} robot {time}\n")
        rows.append(f"FLASER {len(ranges)} {words} {place} {place} {time} robot {time}\n")
    file.write_text("".join(rows))
    return file


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of a drive through a room."""
    corners = [(0.0, 0.0), (4.0, 0.0), (4.0, -1.0), (0.0, -1.0)]
    return written(tmp_path_factory.mktemp("carmen") / "room.log", corners)


@pytest.mark.timeout(400)  # a cold cache: all of it is compiled
def test_the_folder_has_trajectory_map_graph_and_report(log, tmp_path):
    out = tmp_path / "out"
    result = run("--log", log, "--out", out, "--plot", out.parent / "plot.png")
    assert result.exit_code == 0, result.output
    rows = np.loadtxt(out / "trajectory.tum")
    assert np.hypot(*rows[-1, 1:3]) == pytest.approx(np.hypot(0.3, 1.0), abs=0.05)
    assert (out.parent / "plot.png").stat().st_size > 1000
    assert (out / "closures.csv").read_text().startswith("keyframe,other,")
    report = json.loads((out / "report.json").read_text())
    assert report["scans"] == len(rows)
    assert report["unmatched"] == 0
    assert (report["verdict"], report["reasons"]) == ("good", [])
    grid = load_map(out / "map.yaml")
    x = grid.centre_of(np.argwhere(grid.occupied()))[:, 0]
    # The robot sees the room from (0, 0) on: its right wall stands at x = 6.
    assert np.count_nonzero(np.abs(x - 6.0) < 0.06) > 60
    assert np.count_nonzero(x > 6.15) < 5
    optimised = CliRunner().invoke(app, ["optimise", str(out / "graph.g2o")])
    assert optimised.exit_code == 0, optimised.output


@pytest.mark.timeout(400)
def test_beams_in_reverse_order_are_named_and_are_no_map(tmp_path):
    corners = [(0.0, 0.0), (4.0, 0.0), (4.0, -1.0), (0.0, -1.0), (0.0, 0.0), (4.0, 0.0)]
    log = written(tmp_path / "reversed.log", corners, lambda ranges: ranges[::-1])
    result = run("--log", log, "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert "verdict: not a map because the scans turn against the odometry" in result.output
    assert "beams are in reverse order" in result.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["verdict"] == "not a map"
    assert (tmp_path / "out" / "map.pgm").exists()


@pytest.mark.timeout(400)
def test_pictures_are_shown_beside_the_keyframes_of_their_time(log, tmp_path):
    pictures = tmp_path / "rgb"
    pictures.mkdir()
    rng = np.random.default_rng(3)
    for number in range(12):
        image = Image.fromarray(rng.integers(0, 255, (120, 160), np.uint8))
        image.save(pictures / f"{1000.05 + 0.8 * number:.6f}.png")
    last = pictures / "1008.850000.png"  # the last one, cut short
    last.write_bytes(last.read_bytes()[:2000])
    result = run("--log", log, "--images", pictures, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "0 of 11 images recognised" in result.output
    assert "1 picture left out, the first: " in result.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["images"]["looked_at"] == 11
    assert sum(report["images"]["refused"].values()) == 11
    rows = (tmp_path / "out" / "images.csv").read_text().splitlines()
    assert rows[0].startswith("image,candidate,score")
    assert rows[1].startswith(str(pictures / "1000.050000.png"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--images", "DIR"), "1 images of 5.000 to 5.000 s, none of the time of the log's scans"),
        (("--images", "none"), "none: a folder of images is needed, found nothing"),
        (("--sensor", "radar"), "--sensor radar: unknown; allowed is lidar, sonar, camera"),
        (("--sensor", "sonar"), "nothing of a sonar in it, which --sensor sonar needs; it has "),
        (("--solver", "graph"), "are for landmarks"),
    ],
)
def test_what_is_wrong_is_said(log, tmp_path, words, message):
    Image.new("L", (8, 8)).save(tmp_path / "5.0.png")
    words = [str(tmp_path) if each == "DIR" else each for each in words]
    result = run("--log", log, "--out", tmp_path / "out", *words)
    assert isinstance(result.exception, RobotctlError)
    assert message in str(result.exception)


def test_a_log_without_echoes_is_refused(tmp_path):
    file = tmp_path / "empty.log"
    file.write_text(
        "".join(
            f"FLASER 180 {' '.join(['81.83'] * 180)} 0 0 0 0 0 0 {t} robot {t}\n"
            for t in range(1, 4)
        )
    )
    result = run("--log", file, "--out", tmp_path / "out")
    assert "3 lidar scans in it, none with 10 echoes" in str(result.exception)
