"""Each script of `examples` runs, is short, and finds what it should."""

import gzip
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
MOST_LINES = 40


def run(name, *arguments, **settings):
    """Run an example; return the numbers in what it printed, line by line."""
    done = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py", *arguments],
        capture_output=True,
        check=False,
        text=True,
        timeout=60,
        cwd=ROOT,
        env={**os.environ, **settings},
    )
    assert done.returncode == 0, done.stderr
    return [
        [float(number) for number in re.findall(r"[-+]?\d+\.?\d*", line)]
        for line in done.stdout.splitlines()
    ]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_is_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MOST_LINES


@pytest.mark.parametrize("name", ["listen_to_simcan", "drive_on_can", "localise_in_a_log"])
def test_an_example_without_its_arguments_says_what_it_needs(name):
    done = subprocess.run(
        [sys.executable, EXAMPLES / f"{name}.py"], capture_output=True, check=False, text=True
    )
    assert done.returncode == 1
    assert f"python examples/{name}.py " in done.stderr
    assert "Traceback" not in done.stderr


def test_both_drives_come_back_to_where_they_began():
    for length_m, x_m, y_m in run("drive_and_odometry"):
        # Four straights of 1 m and a circle of 0.8 m radius.
        assert length_m == pytest.approx(4.0 + 2.0 * 3.14159 * 0.8, abs=1e-3)
        assert abs(x_m) < 1e-3
        assert abs(y_m) < 1e-3


def test_the_sonars_hold_what_the_wheels_lose():
    (odometry_m,), (ekf_m,) = run("ekf_with_sonars")
    assert odometry_m > 0.3
    assert ekf_m < 0.05


def test_the_homography_agrees_with_opencv():
    cv2 = pytest.importorskip("cv2")
    np = pytest.importorskip("numpy")
    marks = np.array([[0.5, 0.3], [0.5, -0.3], [2.0, 0.5], [2.0, -0.5]])
    seen = np.array([[160.0, 420.0], [480.0, 420.0], [228.0, 140.0], [412.0, 140.0]])
    H, _ = cv2.findHomography(seen, marks)
    for u, v, x_m, y_m, _, _ in run("homography_from_four_points"):
        expected = cv2.perspectiveTransform(np.array([[[u, v]]]), H)[0, 0]
        assert (x_m, y_m) == pytest.approx(tuple(expected), abs=1e-3)


def test_bayes_finds_the_door_and_survives_a_wild_range():
    (cell, percent), (mean_m, sigma_m), (gaussian_m, robust_m) = run("bayes_in_a_corridor")
    assert cell == 4
    assert percent > 50
    assert (mean_m, sigma_m) == pytest.approx((2.02, 0.1 / 5**0.5), abs=1e-3)
    assert gaussian_m > 2.4
    assert robust_m == pytest.approx(2.0, abs=0.05)


def test_a_median_removes_wild_readings_and_smoothing_noise():
    (raw_m, _), (median_m, _), (smooth_m, late) = run("filter_sonar_readings")
    assert raw_m > 0.2
    assert smooth_m < median_m < 0.1 * raw_m
    assert late == pytest.approx(2.0 + 1.5)


def test_the_motor_keeps_its_speed_under_load():
    (_, speed_rad_s, free_v), (_, loaded_rad_s, loaded_v) = run("pid_on_a_motor")
    assert speed_rad_s == pytest.approx(10.0, abs=0.05)
    assert loaded_rad_s == pytest.approx(10.0, abs=0.05)
    # 0.5 N m at the wheel through a gear of 20 and 0.9, 1.5 ohm and 0.0225 V s/rad.
    assert loaded_v - free_v == pytest.approx(1.5 * 0.5 / (20 * 0.9) / 0.0225, abs=0.1)


def test_optimal_planners_agree_and_a_curved_path_is_no_shorter():
    (dijkstra_m, _), (astar_m, _), (hybrid_m, _) = figures = run("plan_on_a_map")
    assert astar_m == pytest.approx(dijkstra_m, abs=0.01)
    # From (1, 1) to (5.5, 4) by the door whose southern post is at (5, 2).
    assert math.dist((1, 1), (5.5, 4)) < astar_m <= hybrid_m < 1.1 * astar_m
    assert all(clearance_m > 0 for _, clearance_m in figures)


def test_a_point_halfway_is_as_sure_as_its_factor():
    pytest.importorskip("scipy")
    ((x_m, y_m, *sigmas_m),) = run("pose_graph_own_factor")
    assert (x_m, y_m) == pytest.approx((2.0, 0.0), abs=1e-6)
    assert sigmas_m == pytest.approx([0.1, 0.1])


def test_the_closed_square_is_the_least_squares_solution():
    np, scipy = pytest.importorskip("numpy"), pytest.importorskip("scipy.optimize")
    _, optimum = run("pose_graph")
    turn = math.pi / 2 + 0.1

    def residuals(x):
        poses = np.vstack([np.zeros(3), x.reshape(4, 3)])
        rows = []
        for one, other, length, angle in [*((i, i + 1, 1.0, turn) for i in range(4)), (4, 0, 0, 0)]:
            c, s = np.cos(poses[one, 2]), np.sin(poses[one, 2])
            dx, dy, da = poses[other] - poses[one]
            error = (da - angle + math.pi) % (2 * math.pi) - math.pi
            rows += [10 * (c * dx + s * dy - length), 10 * (c * dy - s * dx), 20 * error]
        return rows

    square = [(1, 0, 1.57), (1, 1, 3.14), (0, 1, 4.71), (0, 0, 6.28)]
    best = scipy.least_squares(residuals, np.ravel(square)).x.reshape(4, 3)
    assert optimum[2:] == pytest.approx(best[:, :2].ravel(), abs=0.011)


@pytest.fixture
def simulated_bus(tmp_path):
    """Run a simulated robot on simcan; give the environment in which its channel is found."""
    settings = {"XDG_RUNTIME_DIR": str(tmp_path)}
    robot, world = (f"configs/{name}.toml" for name in ("diff_drive", "worlds/flat"))
    command = [sys.executable, "-m", "firmware_sim", "--robot", robot, "--world", world]
    with subprocess.Popen(
        [*command, "--bus", "simcan:example"],
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, **settings},
    ) as simulator:
        try:
            assert simulator.stdout.readline().startswith("ready")
            yield settings
        finally:
            simulator.terminate()


def test_signals_are_heard_on_simcan(simulated_bus):
    done = subprocess.run(
        [sys.executable, EXAMPLES / "listen_to_simcan.py", "example"],
        capture_output=True,
        check=False,
        text=True,
        timeout=60,
        env={**os.environ, **simulated_bus},
    )
    assert done.returncode == 0, done.stderr
    assert "SonarRangesA: " in done.stdout
    assert "NmtState=operational" in done.stdout


def test_the_wheels_turn_on_a_can_bus(simulated_bus):
    (left,), (right,) = run("drive_on_can", "example", **simulated_bus)
    assert left > 1000
    assert right == pytest.approx(left, rel=0.05)


def test_the_recorded_robot_is_found_and_drawn(tmp_path):
    log, plot = EXAMPLES / "data" / "patrol.log.gz", tmp_path / "path.png"
    found, scans, x_m, y_m = run("localise_in_a_log", str(log), str(plot))[0]
    assert 0.9 * scans < found <= scans
    last = gzip.decompress(log.read_bytes()).decode().splitlines()[-1].split()
    # FLASER ends in the true pose, the odometry's, two times and a name.
    assert (x_m, y_m) == pytest.approx((float(last[-9]), float(last[-8])), abs=0.1)
    assert plot.read_bytes().startswith(b"\x89PNG")
