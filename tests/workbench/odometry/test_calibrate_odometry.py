"""`robotctl calibrate odometry` from its three sources, and what it makes of them."""

import dataclasses
import math
import tomllib

import numpy as np
import pytest

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.patch import as_overrides
from robotctl.config.robot_file import find_file, load_robot
from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.model.drives.drives import DifferentialDrive, TricycleDrive
from robotctl.model.drives.motion import arc
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.odometry import calibrate_sources, calibrate_squares
from robotctl.workbench.odometry.calibrate_checks import Check
from robotctl.workbench.odometry.calibrate_odometry import calibrate_odometry
from robotctl.workbench.odometry.calibrate_patch import patch_text, patch_values
from robotctl.workbench.odometry.calibrate_sources import run_of_recording, wheels_of
from robotctl.workbench.odometry.calibrate_squares import Campaign
from robotctl.workbench.odometry.options import OdometryCalibrateOptions
from tests.workbench.odometry.lego_drive import NOMINAL, write_lego

DIFFERENTIAL = DifferentialDrive("differential", 0.3, 0.05, 2400)
TRICYCLE = TricycleDrive("tricycle", "front", 0.35, 0.06, 0.9, 3.0, 2400)
LEFT, RIGHT, TRACK = 0.01, -0.015, 0.03
WRONG = (
    f"simulation.errors.wheel_radius=[{LEFT}, {RIGHT}]",
    f"simulation.errors.track_width={TRACK}",
)


@pytest.fixture(scope="module")
def squares():
    """A robot whose wheels and track are wrong, after two squares each way."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibrate_squares, "SQUARES", 2)
        patch.setattr(calibrate_squares, "STRAIGHTS", 2)
        return calibrate_odometry(OdometryCalibrateOptions(find_file("diff_drive"), WRONG))


@pytest.fixture(scope="module")
def lego(tmp_path_factory):
    """A log of a robot whose wheels are 4 % larger, and the track 3 % wider, than nominal."""
    path = write_lego(tmp_path_factory.mktemp("log") / "made_up.txt", 1.04, 1.03)
    return calibrate_odometry(OdometryCalibrateOptions(find_file("diff_drive"), NOMINAL, log=path))


def test_squares_in_lockstep_bring_the_true_robot_within_the_intervals(squares):
    left, right = squares.found.wheel_diameters()
    assert left.low <= 0.1 * (1.0 + LEFT) <= left.high
    assert right.low <= 0.1 * (1.0 + RIGHT) <= right.high
    track = squares.found.interval("track_width_m")
    assert track.low <= 0.3 * (1.0 + TRACK) <= track.high
    ratio = squares.found.interval("wheel_radius_ratio")
    assert ratio.value == pytest.approx((1.0 + RIGHT) / (1.0 + LEFT), abs=5e-4)


def test_with_the_new_values_the_squares_close(squares):
    worst = squares.checks[0]
    assert worst.before_m > 0.1
    assert worst.after_m < 0.02
    assert squares.objections == []


def test_the_patch_is_toml_that_the_robot_takes(squares):
    tables = tomllib.loads(patch_text(squares))
    assert set(tables["drive"]) == {"wheel_radius_m", "wheel_radius_ratio", "track_width_m"}
    config = load_robot(squares.options.robot, as_overrides(patch_values(squares)))
    for key, value in tables["drive"].items():
        assert getattr(config.drive, key) == value
        assert value == pytest.approx(getattr(squares.found.drive, key), rel=1e-5)
    for key, value in tables["odometry"].items():
        assert getattr(config.odometry, key) == value
    assert "--seed 1 --set simulation.errors.wheel_radius=[0.01, -0.015]" in patch_text(squares)


def test_a_drive_that_does_not_end_is_said(monkeypatch, tmp_path):
    mission = tmp_path / "into_the_wall.toml"
    mission.write_text(
        """
        name = "into the wall"
        world = "empty_room"
        start = { x_m = 5.0, y_m = 2.0 }
        [[item]]
        kind = "drive"
        waypoints = [[5.0, 2.0], [6.5, 2.0]]
        time_out_s = 8.0
        """,
        encoding="utf-8",
    )
    monkeypatch.setattr(calibrate_squares, "find_file", lambda _name, _folder: mission)
    campaign = Campaign(find_file("diff_drive"))
    with pytest.raises(CalibrationError, match="did not drive the straight to its end: "):
        next(campaign.drives(OdometryModel(DIFFERENTIAL), lambda _line: None))


def test_a_log_with_a_reference_brings_the_robot_that_made_it(lego):
    radius, track = (lego.found.interval(key) for key in ("wheel_radius_m", "track_width_m"))
    assert radius.value == pytest.approx(1.04 * lego.config.drive.wheel_radius_m, rel=3e-3)
    assert track.value == pytest.approx(1.03 * 0.173, rel=1e-2)
    assert radius.high / radius.low < 1.03
    assert len(lego.halves) == 2


def test_the_second_half_of_a_log_proves_what_the_first_says(lego):
    assert [check.after_m < 0.5 * check.before_m for check in lego.checks] == [True, True]


@pytest.mark.recordings("lego")
def test_the_lego_robots_second_half_errs_half_as_much_with_what_its_first_half_says(recordings):
    """Against the lecture's values: 0.349 mm a tick, 173 mm between the wheels."""
    options = OdometryCalibrateOptions(find_file("diff_drive"), NOMINAL, log=recordings / "lego")
    result = calibrate_odometry(options)
    plain = result.checks[0]
    assert plain.before_m == pytest.approx(0.05, abs=0.01)
    assert plain.after_m < 0.5 * plain.before_m
    # the point that the camera follows, about where the lecture has the scanner
    assert result.found.lever_m[0] == pytest.approx(0.03, abs=0.02)


def test_worse_errors_are_objections(lego):
    worse = dataclasses.replace(lego, checks=(Check("this", 0.1, 0.2), Check("that", 0.2, 0.1)))
    assert worse.objections == ["this: 0.2000 m, before 0.1000 m"]


def test_squares_measured_by_tape_do_as_well(tmp_path):
    """Records as a real robot writes them, and a file of what the tape said of each."""
    lines = ["heading_sigma_deg = 0.01", "tape_sigma_m = 0.001"]
    for i, shape in enumerate(("straight", "left", "right", "straight")):
        mission, folder = find_file(f"calibrate_{shape}", "missions"), tmp_path / f"{shape}{i}"
        folder.mkdir()
        run = LockstepRun(
            SimOptions(find_file("diff_drive"), mission, seed=i, overrides=WRONG, record=folder)
        )
        begin = run.stack.simulation.truth()
        run.run()
        truth = run.stack.simulation.truth()
        start = SE2(begin.x_m, begin.y_m, begin.theta_rad)
        end = start.inverse() @ SE2(truth.x_m, truth.y_m, truth.theta_rad)
        lines += ["[[run]]", f'log = "{shape}{i}"', f"x_m = {end.x_m}", f"y_m = {end.y_m}"]
    file = tmp_path / "runs.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    result = calibrate_odometry(OdometryCalibrateOptions(find_file("diff_drive"), runs=file))
    found = result.found.drive
    assert found.wheel_radii_m[0] == pytest.approx(0.05 * (1.0 + LEFT), rel=2e-3)
    assert found.wheel_radii_m[1] == pytest.approx(0.05 * (1.0 + RIGHT), rel=2e-3)
    assert found.track_width_m == pytest.approx(0.3 * (1.0 + TRACK), rel=4e-3)
    assert result.checks[0].after_m < 0.1 * result.checks[0].before_m


# From recordings to wheels


def recording(**parts):
    return Recording("made up", **parts)


def circle(n=80):
    """Poses on a circle, in steps of 0.05 m and 0.05 rad."""
    pose, poses = SE2(), []
    for _ in range(n + 1):
        poses.append((pose.x_m, pose.y_m, pose.theta_rad))
        pose = arc(pose, 0.05, 0.05)
    return Trajectory(np.arange(n + 1) * 100_000_000, np.array(poses))


@pytest.mark.parametrize("drive", [DIFFERENTIAL, TRICYCLE], ids=lambda drive: drive.kind)
def test_poses_and_velocities_say_the_same_of_the_wheels(drive):
    model, poses = OdometryModel(drive), circle()
    stamps_ns, by_poses = wheels_of(recording(odometry=poses), model)
    _, by_twists = wheels_of(
        recording(
            twist_stamps_ns=poses.stamps_ns,
            twists=np.tile([0.5, 0.5], (len(poses.stamps_ns), 1)),
        ),
        model,
    )
    np.testing.assert_allclose(by_poses, by_twists, atol=1e-9)
    moves = model.moves(model.nothing, by_poses)
    np.testing.assert_allclose(moves[:, :2], 0.05, atol=1e-9)
    np.testing.assert_array_equal(stamps_ns, poses.stamps_ns)


def test_counts_are_turns_of_the_wheels():
    ticks = np.array([[0, 10, 20], [1, 2410, 1220]])
    _, wheels = wheels_of(recording(wheel_ticks=ticks), OdometryModel(DIFFERENTIAL))
    np.testing.assert_allclose(wheels, [[math.tau, math.pi]])


@pytest.mark.parametrize(
    ("parts", "drive", "what"),
    [
        ({}, DIFFERENTIAL, "made up: no reference poses in it"),
        ({"reference": circle()}, DIFFERENTIAL, "no counts, odometry poses or velocities"),
        (
            {"reference": circle(), "wheel_ticks": np.zeros((5, 3), np.int64)},
            TRICYCLE,
            'counts of two wheels, but the robot is of the kind "tricycle"',
        ),
        ({"reference": circle(), "odometry": circle(8)}, DIFFERENTIAL, "9 references while"),
        ({"reference": circle(20), "odometry": circle(20)}, DIFFERENTIAL, "drives 1.0 m, at least"),
    ],
)
def test_a_recording_that_says_too_little_is_refused(parts, drive, what):
    with pytest.raises(CalibrationError, match=what):
        run_of_recording(recording(**parts), OdometryModel(drive))


def test_a_log_of_quite_another_robot_is_refused(tmp_path):
    log = write_lego(tmp_path / "made_up.txt", 1.0, 1.0, metres=12.0)
    with pytest.raises(CalibrationError, match=r"moves 1\d\.\d m where odometry says 4\.\d m"):
        calibrate_odometry(OdometryCalibrateOptions(find_file("diff_drive"), log=log))


def test_a_log_and_runs_at_once_are_refused(tmp_path):
    options = OdometryCalibrateOptions(find_file("diff_drive"), log=tmp_path, runs=tmp_path)
    with pytest.raises(ConfigError, match="--log and --runs"):
        calibrate_odometry(options)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('[[run]]\nlog = "a"\nx_m = 1.0\ny = 2.0', r"y: unknown key; did you mean \"y_m\""),
        ('[[run]]\nlog = "nowhere"\nx_m = 1.0\ny_m = 2.0', "nowhere: no such file or folder"),
        ('[[run]]\nlog = "a"\nx_m = nan\ny_m = 2.0', "x_m"),
        ("run = []", "at least one"),
        ('tape_sigma_m = 0.0\n[[run]]\nlog = "a"\nx_m = 1.0\ny_m = 2.0', "positive and finite"),
    ],
)
def test_a_file_of_runs_that_is_wrong_is_refused(tmp_path, text, what):
    file = tmp_path / "runs.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=what):
        calibrate_sources.runs_of_file(file, OdometryModel(DIFFERENTIAL))
