"""The commands that read logs, on ROS bags."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from robotctl.cli.commands import app
from tests.logs.formats.bags import KINDS, Laser, write_bag
from tests.workbench.localise.recorded_room import write_map

MOUNTED = Laser(0.25, -0.1, 0.4, upside_down=True)


def written(folder, kind):
    """Write a bag beside a map of its room; return its path and the true poses."""
    path = folder / ("drive.bag" if kind == "ros1" else "drive")
    truth = write_bag(path, kind, [MOUNTED], steps=120)
    write_map(folder)
    return path, truth


def run(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result


@pytest.mark.parametrize("kind", KINDS)
def test_map_and_localise(tmp_path, kind):
    path, truth = written(tmp_path, kind)
    made = run("map", "--log", path, "--scans", "even", "--out", tmp_path / "m")
    assert "60 of 120 scans (even), at reference poses" in made.output
    for chart in (tmp_path / "m.yaml", path.parent / "room.yaml"):
        words = ("--map", chart, "--scans", "odd", "--out", tmp_path / "a.tum")
        run("localise", "--log", path, *words, "--report", tmp_path / "a.json")
        report = json.loads((tmp_path / "a.json").read_text())
        assert report["lost"] is False
        assert report["ape"]["rmse_m"] < 0.1
        assert report["echoes_on_map"] > 0.9
        rows = np.loadtxt(tmp_path / "a.tum")
        assert np.hypot(*(rows[10:, 1:3] - truth[1::2][10:, :2]).T).max() < 0.2


def test_characterise(tmp_path):
    path, _ = written(tmp_path, "ros1")
    words = ("--map", path.parent / "room.yaml", "--out", tmp_path / "patch.toml")
    result = run("characterise", "--log", path, "--sensor", "lidar", *words)
    assert result.exit_code in {0, 3}, result.output
    assert "lidar" in result.output


def test_calibrate(tmp_path):
    path, _ = written(tmp_path, "mcap")
    words = ("--robot", "diff_drive", "--out", tmp_path / "patch.toml")
    result = run("calibrate", "odometry", "--log", path, *words)
    assert result.exit_code == 0, result.output
    assert "references" in result.output
