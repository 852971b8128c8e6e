"""`robotctl slam`: its files and its errors."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from robotctl.errors import RobotctlError

ODOMETRY = "# Time [s] forward velocity [m/s] angular velocity [rad/s]\n"


@pytest.fixture
def folder(tmp_path):
    """A MRCLAM folder: a robot that drives past two landmarks."""
    times = np.arange(0.0, 12.0, 0.2)
    rows = "".join(f"{t:.3f} 0.2 0.0\n" for t in times)
    (tmp_path / "Robot1_Odometry.dat").write_text(ODOMETRY + rows)
    (tmp_path / "Barcodes.dat").write_text("6 63\n7 25\n")
    (tmp_path / "Landmark_Groundtruth.dat").write_text("6 4 1 0 0\n7 4 -1 0 0\n")
    seen = []
    for t in times[::2]:
        for code, y in ((63, 1.0), (25, -1.0)):
            dx, dy = 4.0 - 0.2 * t, y
            seen.append(f"{t:.3f} {code} {np.hypot(dx, dy):.4f} {np.arctan2(dy, dx):.4f}\n")
    (tmp_path / "Robot1_Measurement.dat").write_text("".join(seen))
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, ["slam", *map(str, words)])


def test_the_folder_has_trajectory_map_report_and_picture(folder):
    result = run("--log", folder, "--out", folder / "out", "--plot", folder / "plot.png")
    assert result.exit_code == 0, result.output
    assert "2 landmarks, 60 sightings" in result.output
    rows = np.loadtxt(folder / "out" / "trajectory.tum")
    assert rows[-1, 1] == pytest.approx(0.2 * 11.8, abs=0.1)
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["landmarks"] == 2
    assert report["trajectory"] is None  # no reference
    with (folder / "out" / "landmarks.csv").open() as file:
        marks = {row["name"]: row for row in csv.DictReader(file)}
    assert float(marks["6"]["x_m"]) == pytest.approx(4.0, abs=0.2)
    assert float(marks["7"]["y_m"]) == pytest.approx(-1.0, abs=0.1)
    assert (folder / "plot.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--solver", "lmm"), "--solver lmm: unknown; allowed are"),
        (("--features", "lines"), "--features lines: unknown"),
        (("--mrclam-robot", "3"), "no odometry of robot 3"),
        (("--map", "old.keyframes"), "--map: needs --sensor lidar, sonar, camera"),
        (("--out", "nowhere/out"), "does not exist"),
    ],
)
def test_what_is_wrong_is_said(folder, words, message):
    result = run("--log", folder, "--out", folder / "out", *words)
    assert isinstance(result.exception, RobotctlError)
    assert message in str(result.exception)


def test_a_log_without_sightings_is_refused(folder):
    (folder / "Robot1_Measurement.dat").write_text("")
    result = run("--log", folder, "--out", folder / "out")
    assert "no sightings of landmarks in it" in str(result.exception)
