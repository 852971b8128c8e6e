"""Recordings of our own, written by the recorder's log, read as drives."""

import math
from array import array

import msgspec
import numpy as np
import pytest
from mcap.writer import Writer

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.tum import write_tum
from robotctl.logs.mcap.log import McapLog
from robotctl.messages.estimation import CameraView, LidarScan, LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.sensors.sonar import SonarMount
from robotctl.model.trajectory import Trajectory
from robotctl.runtime.flight.recorder import Recorder, RecordHeader
from tests.mavlink.conftest import CONTROL, NAVIGATION

EPOCH_NS = 1_700_000_000_000_000_000
LIDAR = LidarScan(
    1_500_000_000, 0.1, 0.05, -0.5, 0.25, 12.0, array("f", [1.0, math.inf, 2.5]).tobytes()
)


def state(t_s, x_m, sonar_m=(), heard_s=()):
    return msgspec.structs.replace(
        CONTROL,
        stamp_ns=t_s * 10**9,
        x_m=x_m,
        y_m=0.0,
        theta_rad=0.0,
        sonar_m=sonar_m,
        sonar_stamp_ns=tuple(round(1e9 * each) for each in heard_s),
    )


def write(path, *messages):
    with path.open("wb") as file:
        log = McapLog(file, EPOCH_NS, "rover")
        for message in messages:
            log.add(message)
        log.close()


@pytest.fixture
def folder(tmp_path):
    write(tmp_path / "robot-0001.mcap", state(1, 0.0), NAVIGATION, LIDAR)
    write(tmp_path / "robot-0002.mcap", state(2, 1.0))
    return tmp_path


def test_the_logs_of_a_folder_are_one_drive(folder):
    recording = read_recording(folder)
    assert (recording.odometry.stamps_ns - EPOCH_NS).tolist() == [10**9, 2 * 10**9]
    assert recording.odometry.poses[:, 0].tolist() == [0.0, 1.0]
    assert recording.reference is None


def test_one_log_is_read_alone(folder):
    assert len(read_recording(folder / "robot-0002.mcap").odometry.poses) == 1


def test_sonars_are_read_once_at_their_time_with_the_odometry_of_then(tmp_path):
    write(
        tmp_path / "robot-0001.mcap",
        state(0, -1.0, (math.nan,) * 3, (0.0, 0.0, 0.0)),
        state(1, 0.0, (1.0, 2.0, math.nan), (0.9, 0.9, 0.0)),
        state(2, 1.0, (1.5, 2.0, math.inf), (1.75, 0.9, 1.6)),
    )
    first, silent, second = read_recording(tmp_path).sonars
    np.testing.assert_array_equal(first.reading.ranges_m, [1.0, 2.0, math.nan])
    # A new time without a range is an echo that is missing; an old one says nothing.
    np.testing.assert_array_equal(silent.reading.ranges_m, [math.nan, math.nan, math.inf])
    np.testing.assert_array_equal(second.reading.ranges_m, [1.5, math.nan, math.nan])
    # The sound of 1.5 m there and back took 8.7 ms.
    sent_s = 1.75 - 2.0 * 1.5 / 343.0
    assert second.reading.stamp_ns - EPOCH_NS == pytest.approx(sent_s * 1e9, abs=2)
    assert second.odometry.x_m == pytest.approx(sent_s - 1.0)


def test_views_of_the_camera_are_read_as_they_were_but_none_in_trouble(tmp_path):
    view = CameraView(
        1_500_000_000, 0.15, 0.0, 4.0, (-0.2, 0.0, 0.2), (1.0, math.inf, math.nan),
        (0.01, math.nan, math.nan), (0.4, 0.4, 0.4),
    )  # fmt: skip
    blind = msgspec.structs.replace(view, stamp_ns=1_600_000_000, trouble="too dark")
    write(tmp_path / "robot-0001.mcap", state(1, 0.0), state(2, 1.0), view, blind)
    (seen,) = read_recording(tmp_path).views
    assert seen.scan.stamp_ns - EPOCH_NS == 1_500_000_000
    assert (seen.scan.x_m, seen.scan.max_range_m) == (0.15, 4.0)
    np.testing.assert_array_equal(seen.scan.angles_rad, view.angles_rad)
    np.testing.assert_array_equal(seen.scan.ranges_m, view.ranges_m)
    np.testing.assert_array_equal(seen.scan.sigmas_m, view.sigmas_m)
    assert seen.odometry.x_m == pytest.approx(0.5)


def test_where_the_robot_believed_to_be_is_read_while_it_was_localised(tmp_path):
    believed = LocalisationState(
        2 * 10**9, "mcl", LocalisationStatus.LOCALISED, 10.0, 20.0, math.pi / 2, (0.0,) * 6
    )
    lost = msgspec.structs.replace(believed, stamp_ns=3 * 10**9, status=LocalisationStatus.LOST)
    write(tmp_path / "robot-0001.mcap", state(1, 0.0), state(3, 2.0), believed, lost)
    found = read_recording(tmp_path).believed
    assert (found.stamps_ns - EPOCH_NS).tolist() == [2 * 10**9]
    # 1 m ahead in the frame of the odometry, which is turned to the left.
    assert found.poses[0] == pytest.approx([10.0, 21.0, math.pi / 2])


def test_where_the_sonars_sit_stands_in_the_record_of_the_control_loop(folder):
    robot = '{"sonar": [{"name": "front", "x_m": 0.1, "y_m": 0.2, "heading_deg": 45.0}], "a": 1}'
    with (folder / "control-0001.rec").open("wb") as file:
        Recorder(file.write, RecordHeader("1.0", robot, 0.0, 0.0, 0.0))
    assert read_recording(folder).sonar_mounts == (SonarMount("front", 0.1, 0.2, 45.0),)


def test_a_record_that_cannot_be_read_is_noted(folder):
    (folder / "control-0001.rec").write_bytes(b"")
    recording = read_recording(folder)
    assert recording.sonar_mounts == ()
    assert "the record of the control loop cannot be read" in recording.notes[0]


def test_a_scan_of_the_lidar_comes_back_with_the_odometry_of_its_time(folder):
    (entry,) = read_recording(folder).scans
    np.testing.assert_array_equal(entry.scan.ranges_m, [1.0, math.inf, 2.5])
    assert entry.scan.angles_rad == pytest.approx([-0.5, -0.25, 0.0])
    assert (entry.scan.x_m, entry.scan.y_m, entry.scan.max_range_m) == (0.1, 0.05, 12.0)
    assert entry.odometry.x_m == pytest.approx(0.5)


def test_scans_of_two_lidars_keep_their_names_and_are_unwound_by_the_odometry(tmp_path):
    sweep = msgspec.structs.replace(
        LIDAR, ranges=array("f", [1.0, 1.0, 1.0]).tobytes(), name="front", sweep_s=0.2
    )
    rear = msgspec.structs.replace(LIDAR, stamp_ns=1_450_000_000, name="rear")
    write(tmp_path / "robot-0001.mcap", state(1, 0.0), sweep, rear, state(2, 1.0))
    scans = {each.scan.name: each for each in read_recording(tmp_path).scans}
    assert sorted(scans) == ["front", "rear"]
    assert scans["rear"].odometry.x_m == pytest.approx(0.45)
    assert scans["rear"].scan.sweep_s == 0.0
    # At 1 m/s the first beam was measured 0.2 m before the last, the middle one 0.1 m before it.
    angles = np.array([-0.5, -0.25, 0.0])
    x_m = np.cos(angles) + np.array([-0.1, 0.0, 0.1])
    expected = np.stack([x_m, np.sin(angles) + 0.05], axis=1)
    assert scans["front"].scan.points_base() == pytest.approx(expected, abs=1e-4)


def test_the_truth_beside_the_logs_is_the_reference(folder):
    poses = np.array([[5.0, 0.0, 0.0], [7.0, 0.0, 0.0]])
    stamps_ns = EPOCH_NS + np.array([1, 3]) * 10**9
    write_tum(folder / "truth-0001.tum", Trajectory(stamps_ns, poses))
    recording = read_recording(folder)
    assert recording.reference.poses == pytest.approx(poses)
    assert recording.scans[0].reference.x_m == pytest.approx(5.5)


def write_truth(path, begin_s, x_m):
    stamps_ns = EPOCH_NS + np.array([begin_s, begin_s + 1]) * 10**9
    write_tum(path, Trajectory(stamps_ns, np.array([[x_m, 0.0, 0.0]] * 2)))


def test_the_truth_of_a_log_is_that_with_its_number_or_the_last_before(tmp_path):
    for number in range(1, 6):
        write(tmp_path / f"robot-{number:04d}.mcap", state(number, 0.0), state(number + 1, 0.0))
    write_truth(tmp_path / "truth-0001.tum", 1, 10.0)
    write_truth(tmp_path / "truth-0002.tum", 2, 20.0)
    write_truth(tmp_path / "truth-0003.tum", 3, 30.0)
    (tmp_path / "truth-0005.tum").write_bytes(b"")
    found = [read_recording(tmp_path / f"robot-{number:04d}.mcap") for number in range(1, 6)]
    assert [each.reference and each.reference.poses[0, 0] for each in found] == [
        10,
        20,
        30,
        30,
        None,
    ]


def test_a_truth_of_another_time_is_not_that_of_a_log(folder):
    write_truth(folder / "truth-0001.tum", 100, 0.0)
    assert read_recording(folder / "robot-0001.mcap").reference is None
    assert read_recording(folder).reference is None


def test_the_logs_of_a_folder_of_runs_have_the_truths_of_all(folder):
    write_truth(folder / "truth-0001.tum", 0, 1.0)
    write_truth(folder / "truth-0002.tum", 2, 2.0)
    assert read_recording(folder).reference.poses[:, 0].tolist() == [1.0, 1.0, 2.0, 2.0]


def test_a_log_that_a_kill_cut_is_read_up_to_the_cut(tmp_path):
    path = tmp_path / "robot-0001.mcap"
    with path.open("wb") as file:
        log = McapLog(file, EPOCH_NS, "rover")
        log.add(state(1, 0.0))
        log.flush()
        whole = file.tell()
        log.add(state(2, 1.0))
        log.close()
    path.write_bytes(path.read_bytes()[: whole + 10])
    recording = read_recording(path)
    assert recording.odometry.poses[:, 0].tolist() == [0.0]
    assert any("was cut" in note for note in recording.notes)


def test_a_log_without_states_is_refused(tmp_path):
    write(tmp_path / "robot-0001.mcap", NAVIGATION)
    with pytest.raises(LogFormatError, match="no message of the topic `control`"):
        read_recording(tmp_path)


def write_old(path, **topics):
    """Write a log as older versions did: poses and ranges in the message, null for what is not."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(library="robotctl 0.0.1")
        for topic, messages in topics.items():
            channel = writer.register_channel(topic, "json", 0)
            for time_s, message in messages:
                time_ns = EPOCH_NS + round(time_s * 1e9)
                writer.add_message(channel, time_ns, msgspec.json.encode(message), time_ns)
        writer.finish()


def test_a_log_of_a_version_before_the_first_release_is_refused(tmp_path):
    path = tmp_path / "robot-0001.mcap"
    pose = {"stamp_ns": 10**9, "x_m": 0.0, "y_m": 0.0, "theta_rad": 0.0}
    write_old(path, control=[(1, pose | {"sonar_m": [None], "sonar_stamp_ns": [0]})])
    with pytest.raises(LogFormatError, match=r"robot-0001\.mcap: written by a version before 0\.1"):
        read_recording(path)


def test_a_sonar_that_fails_is_not_taken_for_one_that_hears_nothing(tmp_path):
    write(
        tmp_path / "robot-0001.mcap",
        state(0, -1.0, (math.nan, math.nan), (0.0, 0.0)),
        state(1, 0.0, (1.0, 1.0), (0.9, 0.9)),
        state(2, 1.0, (math.nan, math.inf), (1.8, 1.8)),
    )
    first, second = [entry.reading.ranges_m for entry in read_recording(tmp_path).sonars]
    np.testing.assert_array_equal(first, [1.0, 1.0])
    np.testing.assert_array_equal(second, [math.nan, math.inf])
