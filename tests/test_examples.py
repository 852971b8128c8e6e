"""Each script of `examples` runs, is short, and finds what it should."""

import gzip
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


@pytest.mark.parametrize("name", ["listen_to_simcan", "localise_in_a_log"])
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


def test_signals_are_heard_on_simcan(tmp_path):
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
            done = subprocess.run(
                [sys.executable, EXAMPLES / "listen_to_simcan.py", "example"],
                capture_output=True,
                check=False,
                text=True,
                timeout=60,
                env={**os.environ, **settings},
            )
        finally:
            simulator.terminate()
    assert done.returncode == 0, done.stderr
    assert "SonarRangesA: " in done.stdout
    assert "NmtState=operational" in done.stdout


def test_the_recorded_robot_is_found_and_drawn(tmp_path):
    log, plot = EXAMPLES / "data" / "patrol.log.gz", tmp_path / "path.png"
    found, scans, x_m, y_m = run("localise_in_a_log", str(log), str(plot))[0]
    assert 0.9 * scans < found <= scans
    last = gzip.decompress(log.read_bytes()).decode().splitlines()[-1].split()
    # FLASER ends in the true pose, the odometry's, two times and a name.
    assert (x_m, y_m) == pytest.approx((float(last[-9]), float(last[-8])), abs=0.1)
    assert plot.read_bytes().startswith(b"\x89PNG")
