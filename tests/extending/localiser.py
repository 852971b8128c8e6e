"""The localiser of docs/extending.md is chosen by a robot's file and by `--localiser`."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from robotctl.app.localisation.estimators import make_estimators
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import ConfigError
from robotctl.messages.control import ExternalPose
from robotctl.model.geometry.se2 import SE2
from tests.app.localisation.test_estimators import control, pose_in_world


def seen_at(state, found):
    pose = pose_in_world(state, found)
    return pose.x_m, pose.y_m, pose.theta_rad


def test_a_robots_file_chooses_it_and_it_takes_a_pose_at_the_odometry_of_its_time():
    config = load_robot(find_file("diff_drive"), ('localisation.method="trusting"',))
    estimators = make_estimators(config, SE2(1.0, 2.0, math.pi / 2), Path())
    first = control(0, SE2(5.0, 0.0, 0.0))
    began = estimators.step(first, (), (), 0)
    assert seen_at(first, began) == pytest.approx((1.0, 2.0, math.pi / 2))
    ahead = control(10**8, SE2(5.5, 0.0, 0.0))
    driven = estimators.step(ahead, (), (), 10**8)
    assert seen_at(ahead, driven) == pytest.approx((1.0, 2.5, math.pi / 2))
    # The pose is that of the first state, half a metre before.
    pose = ExternalPose(0, 7.0, 8.0, 0.0)
    found = estimators.step(ahead, (), (pose,), 10**8)
    assert found.method == "trusting"
    assert seen_at(ahead, found) == pytest.approx((7.5, 8.0, 0.0))


def test_the_simulation_drives_by_it(tmp_path):
    report = tmp_path / "report.json"
    words = ["sim", "--localiser", "trusting", "--mission", "patrol", "--lockstep", "--headless"]
    words += ["--max-seconds", "2", "--report", str(report)]
    done = subprocess.run(
        [sys.executable, "-m", "robotctl", *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 3, done.stderr  # two seconds are too short for the mission
    assert json.loads(report.read_text())["localisation"]["method"] == "trusting"


def test_settings_without_a_meaning_for_it_are_refused():
    settings = ('localisation.method="trusting"', 'localisation.start="unknown"')
    with pytest.raises(ConfigError, match=r'needs method "mcl", found "trusting"'):
        load_robot(find_file("diff_drive"), settings)
