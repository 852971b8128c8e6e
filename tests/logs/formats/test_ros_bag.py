"""ROS bags written by rosbags' own writers, and what is read of them."""

import math
import sys

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from robotctl.errors import ConfigError
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import is_log, read_recording
from robotctl.model.geometry.se2 import SE2
from tests.logs.formats.bags import KINDS, Bag, Laser, stamp, write_bag
from tests.workbench.localise.recorded_room import BEAMS, WALLS, driven, seen

MOUNTED = Laser(0.25, -0.1, 0.4, upside_down=True)


def path_of(folder, kind):
    return folder / ("drive.bag" if kind == "ros1" else "drive")


def off_walls(points):
    """Distance of points (n, 2) from the nearest wall of the room, (n,) [m]."""
    ax, ay, bx, by = WALLS.T
    along = np.stack([bx - ax, by - ay], axis=1)
    to = points[:, None] - np.stack([ax, ay], axis=1)
    share = np.clip(np.sum(to * along, axis=2) / np.sum(along**2, axis=1), 0.0, 1.0)
    return np.min(np.hypot(*np.moveaxis(to - share[:, :, None] * along, 2, 0)), axis=1)


def assert_echoes_on_walls(recording, truth):
    """Every beam, from its mount at the true pose, must end on a wall, of all scans."""
    assert len(recording.scans) >= len(truth)
    assert_on_walls(recording, truth)


def assert_on_walls(recording, truth, steps=None):
    """Every beam must end on a wall, of the scans that are read, or of these steps."""
    assert recording.scans
    stamps_ns = [entry.scan.stamp_ns for entry in recording.scans]
    steps = steps or [round((at - stamp(0)) / (stamp(1) - stamp(0))) for at in stamps_ns]
    for i, entry in zip(steps, recording.scans, strict=True):
        points = entry.scan.points_base()
        assert len(points) > 100
        x, y, theta = truth[i]
        c, s = math.cos(theta), math.sin(theta)
        world = points @ np.array([[c, s], [-s, c]]) + (x, y)
        assert off_walls(world).max() < 0.06


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("laser", [Laser(), MOUNTED, Laser(0.3, 0.2, -2.0)])
def test_beams_odometry_and_reference_are_those_of_the_drive(tmp_path, kind, laser):
    truth = write_bag(path_of(tmp_path, kind), kind, [laser], slash=kind == "ros1")
    recording = read_recording(path_of(tmp_path, kind))
    assert_echoes_on_walls(recording, truth)
    _, odom = driven(60)
    stamps_ns = [stamp(i) for i in range(60)]
    assert recording.odometry.stamps_ns.tolist() == stamps_ns
    assert recording.odometry.poses[:, :2] == pytest.approx(np.array(odom)[:, :2])
    assert [entry.scan.stamp_ns for entry in recording.scans] == stamps_ns
    turned = np.array([entry.reference.theta_rad for entry in recording.scans]) - truth[:, 2]
    assert np.abs(np.arctan2(np.sin(turned), np.cos(turned))).max() < 1e-6
    poses = [(entry.reference.x_m, entry.reference.y_m) for entry in recording.scans]
    assert np.array(poses) == pytest.approx(truth[:, :2], abs=1e-6)
    assert any("base_footprint in map by tf" in note for note in recording.notes)


@pytest.mark.parametrize(("kind", "suffix"), [("sqlite", "db3"), ("mcap", "mcap")])
def test_the_file_of_a_bag_alone_is_enough(tmp_path, kind, suffix):
    truth = write_bag(tmp_path / "drive", kind, [MOUNTED])
    (file,) = (tmp_path / "drive").glob(f"*.{suffix}")
    assert_echoes_on_walls(read_recording(file), truth)
    (tmp_path / "drive" / "metadata.yaml").unlink()
    assert_echoes_on_walls(read_recording(tmp_path / "drive"), truth)
    assert is_log(file)


def test_parts_of_a_ros_1_bag_in_a_folder_are_one_drive(tmp_path):
    truth = write_bag(tmp_path / "a_0.bag", "ros1", until=30)
    write_bag(tmp_path / "a_1.bag", "ros1", begin=30)
    recording = read_recording(tmp_path)
    assert len(recording.scans) == 60
    assert_echoes_on_walls(recording, truth)
    assert not any("left out" in note for note in recording.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_without_odometry_messages_tf_tells_the_motion(tmp_path, kind):
    truth = write_bag(path_of(tmp_path, kind), kind, [MOUNTED], odometry=False)
    recording = read_recording(path_of(tmp_path, kind))
    assert_echoes_on_walls(recording, truth)
    _, odom = driven(60)
    assert recording.odometry.poses[:, :2] == pytest.approx(np.array(odom)[:, :2])
    assert recording.reference.poses[:, :2] == pytest.approx(truth[:, :2], abs=1e-6)


def test_without_a_frame_above_that_of_the_odometry_there_is_no_reference(tmp_path):
    write_bag(tmp_path / "drive", "mcap", world="")
    recording = read_recording(tmp_path / "drive")
    assert recording.reference is None
    assert {entry.reference for entry in recording.scans} == {None}
    assert any("no reference" in note for note in recording.notes)


def test_a_topic_of_the_truth_is_the_reference(tmp_path):
    truth = write_bag(tmp_path / "drive", "sqlite", world="", truth_topic="/ground_truth/odom")
    recording = read_recording(tmp_path / "drive")
    assert recording.reference.poses[:, :2] == pytest.approx(truth[:, :2])


def test_two_lasers_come_in_the_order_of_their_times_and_a_copy_counts_once(tmp_path):
    lasers = [MOUNTED, Laser(-0.3, 0.0, math.pi, topic="/rear", frame="rear")]
    copy = Laser(MOUNTED.x_m, MOUNTED.y_m, MOUNTED.yaw, True, topic="/scan_filtered")
    truth = write_bag(tmp_path / "drive", "mcap", [*lasers, copy])
    recording = read_recording(tmp_path / "drive")
    assert len(recording.scans) == 120
    assert_echoes_on_walls(recording, truth)
    assert any("/scan_filtered: of the laser of /scan" in note for note in recording.notes)
    assert {each.scan.name for each in recording.scans} == {"", "laser"}


@pytest.mark.parametrize("laser", [Laser(0.3, 0.2, -2.0), MOUNTED])
def test_rays_of_a_sweep_lie_where_the_robot_was_at_their_times(tmp_path, laser):
    sweep_s, step_s = 0.2, 1e-9 * (stamp(1) - stamp(0))
    truth, _ = driven(61)

    def spoil(topic, stamp_ns, message):
        if topic != laser.topic:
            return
        row, ranges = round((stamp_ns - stamp(0)) / (stamp(1) - stamp(0))), []
        (x, y, theta), (_, _, later) = truth[row], truth[row + 1]
        for share in np.linspace(0.0, sweep_s / step_s, BEAMS).tolist():
            turn = share * (later - theta)
            way = 0.2 * share
            at = SE2(
                x + way * math.cos(theta + 0.5 * turn), y + way * math.sin(theta + 0.5 * turn),
                theta + turn,
            )  # fmt: skip
            eye = at.apply(laser.x_m, laser.y_m)
            ranges.append(seen(*eye, at.theta_rad + laser.yaw))
        order = np.arange(BEAMS)[::-1] if laser.upside_down else np.arange(BEAMS)
        message.ranges = np.array(ranges)[np.arange(BEAMS), order].astype(np.float32)
        message.time_increment = sweep_s / (BEAMS - 1)

    write_bag(tmp_path / "drive", "mcap", [laser], spoil=spoil)
    recording = read_recording(tmp_path / "drive")
    assert len(recording.scans) == 60
    for entry in recording.scans[:-1]:  # nothing is known of the motion after the last
        x, y, theta = entry.reference.x_m, entry.reference.y_m, entry.reference.theta_rad
        c, s = math.cos(theta), math.sin(theta)
        world = entry.scan.points_base() @ np.array([[c, s], [-s, c]]) + (x, y)
        assert np.quantile(off_walls(world), 0.95) < 0.03
    first = recording.scans[0].scan
    assert first.stamp_ns - stamp(0) == pytest.approx(1e9 * sweep_s, abs=1e3)


def test_a_laser_that_is_not_level_is_left_out(tmp_path):
    write_bag(tmp_path / "drive", "mcap", [Laser(tilt=0.5)], steps=5)
    recording = read_recording(tmp_path / "drive")
    assert recording.scans == ()
    assert any("5 of 5 scans are not level, left out" in note for note in recording.notes)


def test_readings_out_of_reach_are_no_echoes_and_too_near_ones_none(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    for i in range(3):
        bag.odometry("/odom", "odom", "base_link", stamp(i), (0.2 * i, 0.0, 0.0))
        ranges = np.full(181, 2.0)
        ranges[:6] = 0.0, 0.04, math.nan, math.inf, 5.6, -math.inf
        bag.scan(Laser(), stamp(i), ranges, reach_m=5.6)
    bag.close()
    recording = read_recording(tmp_path / "drive")
    nan, inf = math.nan, math.inf
    for entry in recording.scans:
        np.testing.assert_array_equal(entry.scan.ranges_m[:6], [nan, nan, nan, inf, inf, nan])
        assert entry.scan.max_range_m == pytest.approx(5.6)
    told = read_recording(tmp_path / "drive", max_range_m=1.5)
    assert np.isinf(told.scans[0].scan.ranges_m[6:]).all()
    assert any("does not say where laser is in base_link" in note for note in recording.notes)


def test_a_reach_that_the_echoes_deny_is_not_believed(tmp_path):
    truth = write_bag(tmp_path / "drive", "mcap", reach_m=1.0)
    recording = read_recording(tmp_path / "drive")
    assert any("not believed" in note for note in recording.notes)
    assert_echoes_on_walls(recording, truth)


def test_messages_without_a_time_have_that_of_the_log(tmp_path):
    write_bag(tmp_path / "drive", "mcap", stamped=False)
    recording = read_recording(tmp_path / "drive")
    assert [entry.scan.stamp_ns for entry in recording.scans] == [stamp(i) for i in range(60)]
    assert any("60 messages without a time" in note for note in recording.notes)


def test_a_bag_without_motion_is_refused(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    bag.scan(Laser(), stamp(0), np.full(181, 2.0))
    bag.close()
    with pytest.raises(LogFormatError, match="nothing says how the robot moves: neither nav_msgs"):
        read_recording(tmp_path / "drive")


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_that_is_cut_is_a_damaged_log_and_no_traceback(tmp_path, kind):
    write_bag(path_of(tmp_path, kind), kind)
    path = path_of(tmp_path, kind)
    if path.is_dir():
        (path,) = [*path.glob("*.db3"), *path.glob("*.mcap")]
    data = path.read_bytes()
    for share in (0.3, 0.6, 0.99):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(LogFormatError, match=path.name):
            read_recording(path)


def test_a_unit_of_times_has_no_meaning_for_a_bag(tmp_path):
    write_bag(tmp_path / "drive", "mcap", steps=3)
    with pytest.raises(ConfigError, match=r"--time-unit ms: the times of .* are nanoseconds"):
        read_recording(tmp_path / "drive", time_unit="ms")


@pytest.mark.parametrize("kind", KINDS)
def test_without_rosbags_the_error_names_the_extra(tmp_path, monkeypatch, kind):
    write_bag(path_of(tmp_path, kind), kind, steps=3)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(ConfigError, match=r"rosbags is needed.*\n.*robotctl-source\[bags\]"):
        read_recording(path_of(tmp_path, kind))


def test_a_laser_on_another_frame_of_the_robot_is_where_that_says(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    bag.transform("base_link", "laser", stamp(0), (0.3, 0.1, 0.5), static=True)
    for i in range(3):
        bag.odometry("/odom", "odom", "base_footprint", stamp(i), (0.2 * i, 0.0, 0.0))
        bag.scan(Laser(), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    scan = recording.scans[0].scan
    assert (scan.x_m, scan.y_m) == pytest.approx((0.3, 0.1))
    assert scan.angles_rad[90] == pytest.approx(0.5)
    assert any("laser is in base_link: taken for base_footprint" in n for n in recording.notes)


def test_the_tf_messages_of_old_ros_1_bags_are_read(tmp_path):
    bag = Bag(tmp_path / "drive.bag", "ros1")
    kind = "tf/msg/tfMessage"
    bag.store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
    for i in range(12):
        for parent, child, pose in (
            ("/odom", "/base_link", (0.2 * i, 0.0, 0.1)), ("/base_link", "/laser", (0.3, 0.0, 0.0))
        ):  # fmt: skip
            message = bag.types[kind]([bag.stamped(parent, child, stamp(i), pose)])
            bag.write("/tf", kind, message, stamp(i))
        bag.scan(Laser(frame="/laser"), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive.bag")
    assert recording.odometry.poses[:, 0] == pytest.approx(0.2 * np.arange(12))
    assert [entry.scan.x_m for entry in recording.scans] == pytest.approx([0.3] * 12)
