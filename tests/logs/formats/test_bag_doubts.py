"""ROS bags whose clocks, frames, robots or numbers do not fit: what is doubtful is left out."""

import math

import numpy as np
import pytest

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording
from tests.cli.command import status_of
from tests.logs.formats.bags import KINDS, STEP_NS, Bag, Laser, stamp, write_bag
from tests.logs.formats.test_ros_bag import MOUNTED, assert_on_walls, path_of

SECOND = 10**9


def read(tmp_path, **options):
    """Write a bag as `write_bag` does; return what is read of it, its notes, and the true poses."""
    truth = write_bag(tmp_path / "drive", "mcap", [MOUNTED], **options)
    recording = read_recording(tmp_path / "drive")
    return recording, "\n".join(recording.notes), truth


def shifted(begins, by_ns, since=0):
    """Return a clock that is ahead in topics that begin so, from a step on."""

    def clock(topic, stamp_ns):
        return stamp_ns + by_ns * (topic.startswith(begins) and stamp_ns >= stamp(since))

    return clock


# Clocks


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ahead_s", [-1.6e9, -5, 1, 3600])
def test_scans_of_another_clock_are_left_out_and_it_is_told_by_how_much(
    tmp_path, capsys, kind, ahead_s
):
    bag = path_of(tmp_path, kind)
    write_bag(bag, kind, clock=shifted("/scan", int(ahead_s * SECOND)), steps=20)
    recording = read_recording(bag)
    assert recording.scans == ()
    side = "ahead of" if ahead_s > 0 else "behind"
    words = (
        f"20 of 20 scans of /scan left out: their clock is {abs(ahead_s):.3f} s {side} that of the "
        "odometry"
    )
    assert any(note.startswith(words) for note in recording.notes)
    assert status_of("map", "--log", bag, "--out", tmp_path / "map") == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "map.pgm").exists()


def test_scans_that_are_received_late_have_the_clock_of_the_odometry(tmp_path):
    late = shifted("/scan", SECOND * 4 // 10)
    recording, _, truth = read(tmp_path, log_clock=late)
    assert len(recording.scans) == 60
    assert_on_walls(recording, truth)


def test_a_bag_that_was_played_again_has_one_clock(tmp_path):
    recording, notes, truth = read(
        tmp_path, log_clock=lambda _, stamp_ns: stamp(0) + 10**17 + 2 * (stamp_ns - stamp(0))
    )
    assert len(recording.scans) == 60
    assert "left out" not in notes
    assert_on_walls(recording, truth)


@pytest.mark.parametrize(("begin", "end"), [(0, 20), (40, 60), (20, 40)])
def test_scans_outside_of_the_time_of_the_odometry_are_left_out_and_counted(tmp_path, begin, end):
    recording, notes, truth = read(
        tmp_path, says=lambda topic, i: topic != "/odom" or begin <= i < end
    )
    assert [entry.scan.stamp_ns for entry in recording.scans] == [
        stamp(i) for i in range(begin, end)
    ]
    away_s = 1e-9 * STEP_NS * max(begin, 59 - (end - 1))
    assert (
        f"40 of 60 scans of /scan left out: they lie outside of the time of the odometry, "
        f"{1e-9 * stamp(begin):.15g} s to {1e-9 * stamp(end - 1):.15g} s, by up to {away_s:.3f} s"
    ) in notes
    assert_on_walls(recording, truth)


def test_scans_while_the_odometry_is_missing_are_left_out_unless_the_robot_stands(tmp_path):
    recording, notes, truth = read(
        tmp_path, says=lambda topic, i: topic != "/odom" or not 20 < i < 35
    )
    assert len(recording.scans) == 60 - 14
    assert "14 of 60 scans of /scan left out: the odometry says nothing meanwhile" in notes
    assert_on_walls(recording, truth)
    bag = Bag(tmp_path / "standing", "mcap")
    for i in range(60):
        if i not in range(20, 35):
            bag.odometry("/odom", "odom", "base_link", stamp(i), (1.0, 2.0, 0.3))
        bag.scan(Laser(), stamp(i), np.full(181, 2.0))
    bag.close()
    assert len(read_recording(tmp_path / "standing").scans) == 60


@pytest.mark.parametrize("is_log_set", [False, True])
@pytest.mark.parametrize("since", [20, 40])
def test_of_a_drive_whose_clock_is_set_back_the_longest_part_is_read(tmp_path, since, is_log_set):
    clock = shifted("/", -4 * SECOND, since)
    recording, notes, truth = read(tmp_path, clock=clock, log_clock=clock if is_log_set else None)
    first = 0 if since == 40 else since
    true_ns = [entry.scan.stamp_ns - (first > 0) * -4 * SECOND for entry in recording.scans]
    steps = [round((at - stamp(0)) / STEP_NS) for at in true_ns]
    # Where the log is sorted by its own clock, the times of both parts are lost for 4 s.
    assert 40 - 10 <= len(steps) <= 40
    assert set(steps) <= set(range(first, first + 40))
    assert_on_walls(recording, truth, steps)
    assert "their clock is set back by 3.500 s" in notes or "the robot jumps" in notes
    assert "left out" in notes


def test_a_clock_that_ntp_sets_after_a_start_in_1970_costs_the_shorter_part(tmp_path):
    recording, notes, truth = read(
        tmp_path, clock=lambda topic, at: at - stamp(0) * (at < stamp(20))
    )
    assert len(recording.scans) >= 39
    assert "their clock is set forward by 170000000" in notes
    assert_on_walls(recording, truth)


@pytest.mark.parametrize("topic", ["/scan", "/odom"])
@pytest.mark.parametrize("by_s", [-100, 100])
def test_one_message_at_another_time_is_left_out(tmp_path, topic, by_s):
    def clock(of, stamp_ns):
        return stamp_ns + by_s * SECOND * (of == topic and stamp_ns == stamp(30))

    recording, notes, truth = read(tmp_path, clock=clock)
    what = "scans of /scan" if topic == "/scan" else "poses of /odom"
    assert f"1 of 60 {what} left out: their time is far from that of their neighbours" in notes
    assert len(recording.scans) == 60 - (topic == "/scan")
    assert len(recording.odometry.poses) == 60 - (topic == "/odom")
    assert_on_walls(recording, truth)


def test_repeated_messages_count_once(tmp_path):
    write_bag(tmp_path / "a_0.bag", "ros1", steps=30)
    write_bag(tmp_path / "a_1.bag", "ros1", steps=30)
    recording = read_recording(tmp_path)
    assert len(recording.scans) == len(recording.odometry.poses) == 30
    assert "30 of 60 scans of /scan repeat an earlier one, left out" in recording.notes


def test_the_reference_ends_where_tf_does(tmp_path):
    recording, _, truth = read(tmp_path, says=lambda topic, i: topic != "world" or 10 <= i < 50)
    known = [entry for entry in recording.scans if entry.reference is not None]
    assert [entry.scan.stamp_ns for entry in known] == [stamp(i) for i in range(10, 50)]
    for entry, (x, y, _) in zip(known, truth[10:50], strict=True):
        assert (entry.reference.x_m, entry.reference.y_m) == pytest.approx((x, y), abs=1e-6)


def test_a_map_by_the_reference_leaves_out_the_scans_without_one(tmp_path, capsys):
    write_bag(tmp_path / "drive", "mcap", says=lambda topic, i: topic != "world" or 10 <= i < 50)
    assert status_of("map", "--log", tmp_path / "drive", "--out", tmp_path / "map") == 0
    words = capsys.readouterr()
    assert "20 of 60 scans left out: the reference says nothing at their times" in words.err
    assert "40 of 60 scans (all), at reference poses" in words.out


# Frames


@pytest.mark.parametrize("child", ["odom", "map", ""])
@pytest.mark.parametrize("kind", KINDS)
def test_a_child_frame_above_the_robot_is_not_its_base(tmp_path, kind, child):
    truth = write_bag(path_of(tmp_path, kind), kind, [MOUNTED], child=child)
    recording = read_recording(path_of(tmp_path, kind))
    assert_on_walls(recording, truth)
    assert "odometry: /odom, base_footprint in odom" in recording.notes
    told = f"/odom: its child_frame_id {child} is no frame of the robot, base_footprint is taken"
    assert (told in recording.notes) == bool(child)


def test_without_a_name_of_a_base_it_is_the_frame_below_that_of_the_odometry(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    bag.transform("chassis", "laser", stamp(0), (0.3, 0.1, 0.5), static=True)
    for i in range(30):
        pose = (0.2 * i, 0.0, 0.0)
        bag.transform("odom", "chassis", stamp(i), pose)
        bag.odometry("/odom", "odom", "odom", stamp(i), pose)
        bag.scan(Laser(), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert [entry.scan.x_m for entry in recording.scans] == [pytest.approx(0.3)] * 30
    assert "odometry: /odom, chassis in odom" in recording.notes


@pytest.mark.parametrize("parent", ["odom", "map"])
def test_a_laser_that_does_not_go_with_the_robot_is_left_out(tmp_path, parent):
    bag = Bag(tmp_path / "drive", "mcap")
    bag.transform(parent, "laser", stamp(0), (0.3, 0.1, 0.5), static=True)
    write_bag(None, "mcap", [Laser(frame="other", topic="/other")], bag=bag)
    for i in range(60):
        bag.scan(Laser(), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert len(recording.scans) == 60
    notes = "\n".join(recording.notes)
    assert "scans of /scan left out: laser is not on the robot, it travels in base_footpr" in notes


def test_a_laser_whose_frame_hangs_apart_is_left_out(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    bag.transform("mast", "laser", stamp(0), (0.3, 0.1, 0.5), static=True)
    write_bag(None, "mcap", [], bag=bag)
    for i in range(60):
        bag.scan(Laser(), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert recording.scans == ()
    assert (
        "scans of /scan left out: tf has laser and base_footprint, but nothing between them"
    ) in recording.notes


def test_scans_while_tf_does_not_say_where_the_laser_is_are_left_out(tmp_path):
    """A laser that turns on a joint, of which tf tells only for a while."""
    bag = Bag(tmp_path / "drive", "mcap")
    write_bag(None, "mcap", [], bag=bag)
    for i in range(60):
        if 10 <= i < 40:
            bag.transform("base_link", "laser", stamp(i), (0.0, 0.0, 0.1 * i))
        bag.scan(Laser(), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert [entry.scan.stamp_ns for entry in recording.scans] == [stamp(i) for i in range(10, 40)]
    notes = "\n".join(recording.notes)
    assert "30 of 60 scans of /scan left out: tf does not say where laser is in base_foot" in notes


def test_of_two_parents_of_a_frame_the_one_that_is_told_most_often_counts(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    for i in range(0, 60, 3):
        bag.transform("odom_combined", "base_footprint", stamp(i), (9.0, 9.0, 1.0))
    truth = write_bag(None, "mcap", [MOUNTED], bag=bag, odometry=False)
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert_on_walls(recording, truth)
    notes = "\n".join(recording.notes)
    assert "tf has base_footprint in odom and in odom_combined: odom is taken" in notes


# Robots


def two_robots(tmp_path, first, second):
    bag = Bag(tmp_path / "drive", "mcap")
    for options, seed in ((first, 1), (second, 2)):
        write_bag(None, "mcap", bag=bag, seed=seed, steps=20, **options)
    bag.close()
    return tmp_path / "drive"


@pytest.mark.parametrize(
    ("first", "second", "named"),
    [
        (
            {"prefix": "r1/", "space": "/r1"},
            {"prefix": "r2/", "space": "/r2"},
            r"2 robots in it, r1 \(/r1/odom, /r1/scan, /r1/tf, /r1/tf_static\) and r2 \(/r2/od",
        ),
        (
            {"prefix": "r1/"},
            {"prefix": "r2/"},
            r"2 robots in it, r1 \(/odom, /scan\) and r2 \(/odom, /scan\)",
        ),
        (
            {"space": "/r1"},
            {"space": "/r2"},
            r"2 robots in it, r1 \(/r1/odom, /r1/scan, /r1/tf, /r1/tf_static\) and r2 \(/r2/od",
        ),
        (
            {},
            {"prefix": "r2/", "space": "/r2"},
            r"2 robots in it, one without a name \(/odom\) and r2 \(/r2/odom, /r2/scan, /r2/tf, /",
        ),
        (
            {"prefix": "r1/", "odometry": False},
            {"prefix": "r2/", "odometry": False},
            r"2 robots in it, r1 \(/scan\) and r2 \(/scan\)",
        ),
    ],
)
def test_two_robots_in_a_bag_are_refused_by_their_names(tmp_path, first, second, named):
    with pytest.raises(LogFormatError, match=named):
        read_recording(two_robots(tmp_path, first, second))


def test_the_refusal_says_how_to_take_one_robot_out(tmp_path):
    bag = two_robots(tmp_path, {"prefix": "r1/", "space": "/r1"}, {"prefix": "r2/", "space": "/r2"})
    with pytest.raises(
        LogFormatError,
        match=rf"rosbags-convert --src {bag} --dst one --exclude-topic /r2/odom /r2/scan /r2/tf ",
    ):
        read_recording(bag)


def test_tf_of_a_robot_that_is_not_in_the_bag_otherwise_is_not_mixed_in(tmp_path):
    says = {"says": lambda topic, _: topic not in {"/odom", "/scan", "/r2/scan"}}
    with pytest.raises(
        LogFormatError, match=r"2 robots in it, r1 \(.*\) and r2 \(/r2/tf, /r2/tf_s"
    ):
        read_recording(two_robots(tmp_path, {"space": "/r1"}, {"space": "/r2", **says}))


def test_two_robots_that_share_all_names_jump(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    for i in range(40):
        bag.odometry("/odom", "odom", "base_link", stamp(i), (0.2 * i, 0.0, 0.0))
        bag.odometry("/odom", "odom", "base_link", stamp(i) + 10**7, (50.0 - 0.2 * i, 9.0, 0.0))
    bag.close()
    with pytest.raises(LogFormatError, match="of several robots, or of several drives"):
        read_recording(tmp_path / "drive")


def test_scans_of_another_robot_are_left_out(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    truth = write_bag(None, "mcap", [MOUNTED], bag=bag, prefix="r1/", space="/r1")
    for i in range(60):
        bag.scan(Laser(topic="/r2/scan", frame="r2/laser"), stamp(i), np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert len(recording.scans) == 60
    assert_on_walls(recording, truth)
    assert "scans of /r2/scan left out: they are not of the robot r1" in recording.notes


@pytest.mark.parametrize("options", [{"prefix": "r1/", "space": "/r1"}, {"space": "/r1"}])
def test_one_robot_with_a_name_is_read_as_one_without(tmp_path, options):
    recording, notes, truth = read(tmp_path, **options)
    assert len(recording.scans) == 60
    assert_on_walls(recording, truth)
    assert recording.reference.poses[:, :2] == pytest.approx(truth[:, :2], abs=1e-6)
    assert "left out" not in notes


def test_several_odometries_of_one_robot_are_no_robots(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    truth = write_bag(None, "mcap", [MOUNTED], bag=bag)
    for i in range(60):
        bag.odometry("/wheel/odometry", "odom", "base_link", stamp(i), (0.2 * i, 0.0, 0.0))
        bag.odometry("/odometry/filtered", "odom", "base_link", stamp(i), (0.2 * i, 0.1, 0.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert_on_walls(recording, truth)
    assert any("odometry in /odom, /odometry/filtered, /wheel" in n for n in recording.notes)


def test_an_odometry_that_begins_anew_is_read_to_there(tmp_path):
    bag = Bag(tmp_path / "drive", "mcap")
    for i in range(60):
        pose = (3.0 + 0.2 * i, 0.0, 0.0) if i < 40 else (0.2 * (i - 40), 0.0, 0.0)
        bag.odometry("/odom", "odom", "base_link", stamp(0) + i * 10**8, pose)
        bag.scan(Laser(), stamp(0) + i * 10**8, np.full(181, 2.0))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert len(recording.odometry.poses) == len(recording.scans) == 36
    notes = "\n".join(recording.notes)
    assert "poses of /odom: the robot jumps 1 time, first at 1700000004 s by 10.80 m" in notes
    assert "24 of 60 poses are left out" in notes


# Numbers

SCAN_FIELDS = ["angle_min", "angle_increment", "range_min"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", SCAN_FIELDS)
def test_a_scan_with_a_number_that_cannot_be_is_left_out_by_topic_time_and_number(
    tmp_path, field, value
):
    def spoil(topic, stamp_ns, message):
        if topic == "/scan" and stamp_ns == stamp(3):
            object.__setattr__(message, field, value)

    recording, _, truth = read(tmp_path, spoil=spoil, steps=10)
    assert len(recording.scans) == 9
    assert_on_walls(recording, truth)
    assert (
        f"1 of 10 scans of /scan left out: {field} is {value}; the first at 1700000001.5 s"
    ) in recording.notes


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize(
    ("part", "field", "told"),
    [
        ("position", "x", "the position is"),
        ("position", "y", "the position is"),
        ("orientation", "z", "the orientation is"),
        ("orientation", "w", "the orientation is"),
    ],
)
def test_a_pose_with_a_number_that_is_not_finite_is_left_out(tmp_path, part, field, told, value):
    def spoil(topic, stamp_ns, message):
        if topic == "/odom" and stamp_ns == stamp(3):
            object.__setattr__(getattr(message.pose.pose, part), field, value)

    recording, notes, truth = read(tmp_path, spoil=spoil, steps=10)
    assert len(recording.odometry.poses) == 9
    assert_on_walls(recording, truth)
    assert f"1 of 10 poses of /odom left out: {told}" in notes
    assert "the first at 1700000001.5 s" in notes


def test_a_pose_beyond_the_earth_is_none(tmp_path):
    def spoil(topic, stamp_ns, message):
        if topic == "/odom" and stamp_ns == stamp(3):
            object.__setattr__(message.pose.pose.position, "x", 1e300)

    recording, notes, truth = read(tmp_path, spoil=spoil, steps=10)
    assert_on_walls(recording, truth)
    assert "1 of 10 poses of /odom left out: they are no poses; the first, at 17000000" in notes


def test_a_transform_that_is_not_finite_is_left_out(tmp_path):
    def spoil(topic, stamp_ns, message):
        if topic == "/tf" and stamp_ns == stamp(3):
            object.__setattr__(message.transforms[0].transform.translation, "x", math.nan)

    recording, _, truth = read(tmp_path, spoil=spoil, steps=10)
    assert_on_walls(recording, truth)


def test_beams_beyond_two_turns_and_scans_without_ranges_are_none(tmp_path):
    def spoil(topic, stamp_ns, message):
        if topic == "/scan" and stamp_ns == stamp(3):
            object.__setattr__(message, "angle_increment", 1e30)
        if topic == "/scan" and stamp_ns == stamp(4):
            object.__setattr__(message, "ranges", np.empty(0, np.float32))

    recording, notes, truth = read(tmp_path, spoil=spoil, steps=10)
    assert len(recording.scans) == 8
    assert_on_walls(recording, truth)
    assert "2 of 10 scans of /scan left out: 181 ranges from angle_min" in notes
    assert "it has no ranges" in notes


# Damage


@pytest.mark.parametrize("content", [b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01", b"#ROSBAG V2.0\n"])
def test_a_bag_of_a_few_bytes_is_a_sentence(tmp_path, capsys, content):
    path = tmp_path / ("drive.bag" if content.startswith(b"#") else "drive.mcap")
    path.write_bytes(content)
    assert status_of("map", "--log", path, "--out", tmp_path / "map") == 2
    words = capsys.readouterr().err
    assert words.startswith(f"robotctl: {path}: the bag is damaged or incomplete: ")
    assert "Traceback" not in words
    advice = "rosbag reindex" if path.suffix == ".bag" else f"robotctl record recover {path}"
    assert advice in words


def test_any_damage_of_a_bag_is_a_sentence_or_nothing(tmp_path):
    """Three changed bytes each, of a bag of each kind, in any place."""
    rng = np.random.default_rng(5)
    for kind in KINDS:
        (tmp_path / kind).mkdir()
        bag = path_of(tmp_path / kind, kind)
        write_bag(bag, kind, steps=5)
        if bag.is_dir():
            (bag,) = [*bag.glob("*.db3"), *bag.glob("*.mcap")]
        content = bag.read_bytes()
        for _ in range(40):
            damaged = bytearray(content)
            for at in rng.integers(16, len(content), 3).tolist():
                damaged[at] = int(rng.integers(256))
            bag.write_bytes(damaged)
            try:
                recording = read_recording(bag)
            except LogFormatError as error:
                assert bag.name in str(error)  # noqa: PT017 - either is right
            else:
                assert np.isfinite(recording.odometry.poses).all()
