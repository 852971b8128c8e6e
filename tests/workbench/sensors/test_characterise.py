"""`robotctl characterise`, from the drive or the log to the patch."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robotctl import toml_source
from robotctl.app.localisation.map_sensors import MapSensors
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.cli.characterise.plot import save_plot
from robotctl.config.patch import as_overrides
from robotctl.config.robot_file import RobotConfig, find_file, load_robot
from robotctl.errors import CalibrationError, ConfigError
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.logs.formats.tum import write_tum
from robotctl.logs.log_poses import best_poses
from robotctl.maps.localisation_map import load_localisation_map
from robotctl.model.drives.odometry_noise import MotionNoise
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedSonar, Recording
from robotctl.model.sensors.measurement import MotionMeasurement, RangeMeasurement
from robotctl.model.sensors.sonar import SonarReading
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.sensors.characterise import characterise, told
from robotctl.workbench.sensors.options import CharacteriseOptions
from robotctl.workbench.sensors.patch import patch_text, patch_values
from robotctl.workbench.sensors.sources import CALIBRATIONS, Source, source_of_log, taken

TRUTH = "truth-0001.tum"
QUIET = "simulation.sonar.crosstalk_probability=0.0"
ROBOT = find_file("diff_drive")


@pytest.fixture(scope="module")
def simulated():
    return characterise(CharacteriseOptions(ROBOT, (QUIET,), seed=2))


def test_a_simulated_drive_recovers_the_sonars_of_the_simulation(simulated):
    values, limit = simulated.fit.ranges.values, simulated.fit.incidence.limit
    truth = {"sigma_m": 0.003, "sigma_per_m": 0.004, "none": 0.005, "garbage": 0.995 * 0.005}
    for name, value in truth.items():
        assert values[name].low <= value <= values[name].high, name
        assert values[name].value == pytest.approx(value, rel=0.5), name
    assert math.degrees(limit.low) <= 35.0 <= math.degrees(limit.high)
    assert simulated.fit.greatest_m.low <= 4.0 <= simulated.fit.greatest_m.high
    # None is short, but by chance some of the garbage looks as if a few were.
    assert all(each.startswith("rate of short readings") for each in simulated.hidden)


def test_the_patch_is_what_the_localiser_would_read(simulated, tmp_path):
    file = tmp_path / "robot.toml"
    text = ROBOT.read_text() + "\n" + patch_text(simulated)
    file.write_text(text)
    assert load_robot(file).localisation == simulated.patched
    by_settings = toml_source.load(ROBOT, RobotConfig, as_overrides(patch_values(simulated)))
    assert by_settings.localisation == simulated.patched


def test_the_patch_helps_to_tell_places_and_is_no_narrower_than_particles_are(simulated):
    assert simulated.told_after > simulated.told_before
    sonar = patch_values(simulated)["localisation.sonar"]
    assert sonar["sigma_m"] >= 0.05
    assert sonar["random"] >= simulated.fit.ranges.values["garbage"].high


def test_the_plot_is_drawn(simulated, tmp_path):
    file = tmp_path / "plot.png"
    save_plot(simulated, file)
    assert file.read_bytes().startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded")
    options = SimOptions(
        ROBOT, find_file("patrol", "missions"), seed=2, overrides=(QUIET,), record=folder
    )
    for i, _ in enumerate(LockstepRun(options).steps()):
        if i > 200:
            break
    stamps_ns = range(0, 20 * 10**9, 10**8)
    write_tum(folder / TRUTH, Trajectory.of(stamps_ns, [SE2(1.0, 1.0) for _ in stamps_ns]))
    return folder


def test_a_recording_of_ours_is_read_with_its_truth_and_each_frame_of_its_sonars(recorded):
    config = load_robot(ROBOT)
    source = source_of_log(recorded, "flat", "", config)
    assert source.sensor == "sonar"
    assert source.poses_by == "the simulation's truth"
    assert source.mounts == config.sonar
    have = taken(source, config)
    # 10 s, eight sonars, twenty times a second each, but for the start.
    assert len(have.readings.ranges_m) == pytest.approx(1600, rel=0.1)
    assert np.isinf(have.readings.ranges_m).any()


def test_what_a_recording_cannot_tell_is_said(recorded):
    config = load_robot(ROBOT)
    with pytest.raises(ConfigError, match="give the room with --map"):
        source_of_log(recorded, "", "", config)
    with pytest.raises(CalibrationError, match="no lidar scans"):
        source_of_log(recorded, "flat", "lidar", config)
    (recorded / TRUTH).rename(recorded / "away.tum")
    try:
        with pytest.raises(CalibrationError, match="the poses of the readings are unknown"):
            source_of_log(recorded, "flat", "", config)
    finally:
        (recorded / "away.tum").rename(recorded / TRUTH)


def test_a_recording_of_a_robot_with_other_sonars_is_refused_with_both_numbers(tmp_path):
    other = load_robot(ROBOT, ("sonar=[]",))
    options = SimOptions(ROBOT, find_file("patrol", "missions"), max_seconds=1.0, record=tmp_path)
    for _ in LockstepRun(options).steps():
        pass
    (tmp_path / "control-0001.rec").unlink()
    with pytest.raises(CalibrationError, match=r"8 sonars in it, but .* diff_drive has 0: give"):
        source_of_log(tmp_path, "flat", "", other)


def test_one_file_of_a_recording_has_the_truth_of_its_folder(recorded):
    source = source_of_log(recorded / "robot-0001.mcap", "flat", "", load_robot(ROBOT))
    assert source.poses_by == "the simulation's truth"


def test_readings_at_poses_that_nobody_knows_judge_no_settings():
    reading = RecordedSonar(SonarReading(20 * 10**9, (1.0,) * 8), SE2())
    poses = Trajectory.of([0, 10**9], [SE2(1.0, 1.0), SE2(1.0, 1.0)])
    chart = load_localisation_map("flat", Path())
    config = load_robot(ROBOT)
    recording = Recording("log", sonars=(reading,))
    source = Source("sonar", recording, poses, chart, config.sonar, "the reference", "")
    sensors = MapSensors(chart, SensedRobot(config.sonar, config.localisation))
    with pytest.raises(CalibrationError, match="the reference gives no pose for any reading"):
        told(source, sensors, config.odometry)


def test_the_robots_own_belief_stands_in_for_a_reference_that_is_missing():
    there, here = (Trajectory.of([0, 10], [SE2(x_m), SE2(x_m + 1.0)]) for x_m in (5.0, 0.0))
    log = Path("log")
    both = Recording("log", reference=there, believed=here)
    assert best_poses(log, both) == (there, "the log's reference")
    poses, words = best_poses(log, replace(both, reference=None))
    assert poses is here
    assert "errors count as the sensor's" in words
    # Positions without a heading do not say where a sensor looked.
    assert best_poses(log, replace(both, reference_has_heading=False))[0] is here
    assert best_poses(log, Recording("log")) is None


def along(x_m: float, stamp_s: float) -> tuple[int, SE2]:
    return round(1e9 * stamp_s), SE2(x_m, 0.0, 0.0)


def test_between_sparse_references_odometry_says_where_the_robot_was():
    # It stands for 0.9 s, then drives 0.1 m; the reference has a pose each second alone.
    odometry = Trajectory.of(
        *zip(*[along(5.0, 0.0), along(5.0, 0.9), along(5.1, 1.0)], strict=True)
    )
    poses = Trajectory.of(*zip(*[along(1.0, 0.0), along(1.1, 1.0)], strict=True))
    chart = load_localisation_map("flat", Path())
    source = Source("sonar", Recording("log", odometry=odometry), poses, chart, (), "", "")
    noise = MotionNoise()
    assert source.pose_at(900_000_000, noise).x_m == pytest.approx(1.0)
    assert source.pose_at(950_000_000, noise).x_m == pytest.approx(1.05)
    assert source.pose_at(10**9, noise).x_m == pytest.approx(1.1)
    assert source.pose_at(2 * 10**9, noise) is None
    # An odometry that is rough leaves nobody sure.
    assert source.pose_at(950_000_000, MotionNoise(0.2, 0.2, 0.2)) is None
    alone = replace(source, recording=Recording("log"))
    assert alone.pose_at(900_000_000, noise).x_m == pytest.approx(1.09)


def test_readings_become_measurements_with_time_frame_and_deviations():
    config = load_robot(ROBOT)
    heard = (1.0, math.inf, *(6 * [math.nan]))
    recording = Recording("log", sonars=(RecordedSonar(SonarReading(7, heard), SE2()),))
    kind = CALIBRATIONS["sonar"]
    (found,) = kind.measurements(recording, config.sonar, config.localisation)
    assert found.stamp_ns == 7
    assert found.beams[0].tolist() == [
        config.sonar[0].x_m,
        config.sonar[0].y_m,
        config.sonar[0].heading_rad,
    ]
    sigma_m = config.localisation.sonar.sigma_m + config.localisation.sonar.sigma_per_m
    assert found.sigmas_m[0] == pytest.approx(sigma_m)
    with pytest.raises(ValueError, match="must be"):
        RangeMeasurement(0, np.zeros((2, 3)), np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="before"):
        MotionMeasurement(5, 4, SE2(), np.eye(3))
    with pytest.raises(ValueError, match="covariance"):
        MotionMeasurement(4, 5, SE2(), np.eye(2))


def test_another_sensor_is_refused():
    with pytest.raises(ConfigError, match='must be lidar or sonar; did you mean "lidar"'):
        CharacteriseOptions(ROBOT, sensor="lider")


@pytest.mark.recordings("carmen/seattle-corrected.log.gz")
def test_a_lidar_log_is_measured_against_the_map_of_its_even_scans(recordings):
    log = recordings / "carmen" / "seattle-corrected.log.gz"
    found = characterise(CharacteriseOptions(ROBOT, log=log))
    values = found.fit.ranges.values
    assert values["hit"].value > 0.9
    assert 0.01 < values["sigma_m"].value < 0.05
    assert "echoes do not end" in found.fit.incidence.limit.why_not
    assert "even scans" in found.source.map_by
    (sigma,) = [line for line in patch_text(found).splitlines() if line.startswith("sigma_m")]
    mixture, typical_m = found.fit.ranges.mixture, found.fit.ranges.typical_m
    assert f"{mixture.sigma_m + mixture.sigma_per_m * typical_m:.3g} at the usual range" in sigma
