"""CARMEN logs, written here line by line, and what is read of them."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from robotctl.logs.formats.carmen_log import read_carmen
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.recorded_log import read_recording


def flaser(ranges, laser, robot, time_s, word="FLASER"):
    values = [len(ranges), *ranges, *laser, *robot, time_s]
    return f"{word} {' '.join(str(value) for value in values)} host {time_s}"


def odom(pose, time_s):
    return f"ODOM {pose[0]} {pose[1]} {pose[2]} 0.1 0.0 0.0 {time_s} host {time_s}"


def robot_laser(ranges, laser, robot, time_s, remissions=(), head="0 -1.5 3.0 0.01 30.0 0.01 0"):
    values = [len(ranges), *ranges, len(remissions), *remissions, *laser, *robot]
    numbers = " ".join(str(value) for value in values)
    return f"ROBOTLASER1 {head} {numbers} 0.1 0.2 0.3 0.4 0.5 {time_s} host {time_s}"


def log(folder: Path, *lines: str, end: str = "\n") -> Path:
    path = folder / "drive.log"
    path.write_text("# CARMEN Logfile\n" + "\n".join(lines) + end)
    return path


BEAMS = [1.0 + 0.01 * i for i in range(180)]
SCAN = flaser(BEAMS, (1.0, 2.0, 0.5), (0.1, 0.2, 0.3), 12.25)


def test_pose_odometry_ranges_and_time_of_a_scan_are_those_of_its_line(tmp_path):
    recording = read_carmen(log(tmp_path, odom((0.0, 0.1, 0.2), 12.0), SCAN))
    (entry,) = recording.scans
    assert entry.scan.stamp_ns == 12_250_000_000
    assert entry.scan.ranges_m == pytest.approx(BEAMS)
    assert (entry.reference.x_m, entry.reference.y_m, entry.reference.theta_rad) == (1.0, 2.0, 0.5)
    assert (entry.odometry.x_m, entry.odometry.y_m, entry.odometry.theta_rad) == (0.1, 0.2, 0.3)
    assert recording.odometry.stamps_ns.tolist() == [12_000_000_000]
    assert recording.odometry.poses.tolist() == [[0.0, 0.1, 0.2]]
    assert recording.reference.poses.tolist() == [[1.0, 2.0, 0.5]]


@pytest.mark.parametrize(
    ("beams", "first_deg", "last_deg"),
    [
        (180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90),
        (401, -50, 50), (100, -50, 49), (541, -90, 90), (1, -90, -90),
    ],
)  # fmt: skip
def test_the_number_of_readings_tells_the_field_of_view(tmp_path, beams, first_deg, last_deg):
    line = flaser([2.0] * beams, (0, 0, 0), (0, 0, 0), 1.0)
    angles = read_carmen(log(tmp_path, line)).scans[0].scan.angles_rad
    assert len(angles) == beams
    assert np.degrees(angles[[0, -1]]) == pytest.approx([first_deg, last_deg])
    assert np.ptp(np.diff(angles)) < 1e-12 if beams > 2 else True


def test_readings_at_the_maximum_are_infinite_and_readings_of_nothing_are_none(tmp_path):
    ranges = [1.0, 0.0, 79.9, 81.0, 81.91, -1.0]
    parameter = "PARAM robot_front_laser_max 80.99 host 0"
    scan = read_carmen(log(tmp_path, parameter, flaser(ranges, (0, 0, 0), (1, 0, 0), 1.0))).scans[0]
    assert scan.scan.max_range_m == 80.99
    expected = [1.0, math.nan, 79.9, math.inf, math.inf, math.nan]
    np.testing.assert_array_equal(scan.scan.ranges_m, expected)


@pytest.mark.parametrize(
    ("longest", "reach"), [(81.83, 81.83), (81.91, 81.83), (8.191, 8.183), (31.0, 81.83)]
)
def test_without_a_parameter_the_error_codes_of_the_laser_tell_its_reach(tmp_path, longest, reach):
    ranges = [*np.linspace(1.0, 5.0, 179).round(3), longest]
    scan = read_carmen(log(tmp_path, flaser(ranges, (0, 0, 0), (1, 0, 0), 1.0))).scans[0].scan
    assert scan.max_range_m == reach
    assert math.isinf(scan.ranges_m[-1]) == (longest >= reach)
    assert np.all(np.isfinite(scan.ranges_m[:-1]))


def test_a_length_at_which_readings_pile_up_is_the_reach(tmp_path):
    ranges = [*np.linspace(1.0, 29.0, 140).round(3), *[30.0] * 40]
    scan = read_carmen(log(tmp_path, flaser(ranges, (0, 0, 0), (1, 0, 0), 1.0))).scans[0].scan
    assert scan.max_range_m == 30.0
    assert np.all(np.isinf(scan.ranges_m[140:]))
    assert np.all(np.isfinite(scan.ranges_m[:140]))


def test_in_a_round_room_no_length_is_taken_for_the_reach(tmp_path):
    line = flaser([4.0] * 180, (0, 0, 0), (1, 0, 0), 1.0)
    assert np.all(read_carmen(log(tmp_path, line)).scans[0].scan.ranges_m == 4.0)


def test_the_pose_of_a_front_laser_is_that_of_the_robot_ahead_by_the_offset(tmp_path):
    parameter = "PARAM robot_frontlaser_offset 0.3 host 0"
    laser = (1.0, 2.0, math.pi / 2)
    entry = read_carmen(log(tmp_path, parameter, flaser(BEAMS, laser, (5.0, 5.0, 1.0), 1.0))).scans[
        0
    ]
    assert (entry.scan.x_m, entry.scan.y_m) == (0.3, 0.0)
    assert (entry.reference.x_m, entry.reference.y_m) == pytest.approx((1.0, 1.7))
    assert (entry.odometry.x_m, entry.odometry.y_m) == (5.0, 5.0)


def test_where_a_log_was_corrected_in_place_both_poses_are_the_lasers_and_this_is_said(tmp_path):
    parameter = "PARAM robot_frontlaser_offset -0.04 host 0"
    recording = read_carmen(log(tmp_path, parameter, flaser(BEAMS, (1, 2, 0), (1, 2, 0), 1.0)))
    assert recording.scans[0].odometry.x_m == pytest.approx(1.04)
    assert recording.scans[0].reference.x_m == pytest.approx(1.04)
    assert "both poses of all lines are the same" in recording.notes[0]


@pytest.mark.parametrize("heading", [0.5, 0.5 - math.pi])
def test_a_rear_laser_looks_backwards_whichever_heading_its_line_holds(tmp_path, heading):
    parameter = "PARAM robot_rearlaser_offset -0.2 host 0"
    line = flaser([2.0] * 181, (1.0, 0.0, heading), (0.0, 0.0, 0.4), 1.0, word="RLASER")
    entry = read_carmen(log(tmp_path, parameter, line)).scans[0]
    ahead = entry.scan.angles_rad[90]
    assert math.cos(ahead) == pytest.approx(-1.0)
    assert entry.reference.theta_rad == pytest.approx(0.5)
    back = entry.reference.apply(entry.scan.x_m, entry.scan.y_m)
    assert back == pytest.approx((1.0, 0.0))


def test_scans_of_two_lasers_come_in_the_order_of_the_log(tmp_path):
    lines = [
        flaser(BEAMS, (0, 0, 0), (i, 0, 0), 1.0 + i, word=word)
        for i, word in enumerate(["FLASER", "RLASER", "RLASER", "FLASER"])
    ]
    scans = read_carmen(log(tmp_path, *lines)).scans
    assert [scan.odometry.x_m for scan in scans] == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize("remissions", [(), (7, 8, 9)])
def test_a_robot_laser_line_tells_its_beams_reach_and_mounting(tmp_path, remissions):
    lines = [
        robot_laser([1.0, 2.0, 30.0], (x + 0.1, 0.2, 0.3), (x, 0.2, 0.3), 1.0 + x, remissions)
        for x in (0.0, 1.0)
    ]
    first, second = read_carmen(log(tmp_path, *lines)).scans
    assert first.scan.angles_rad - 0.0 == pytest.approx([-1.5, -1.49, -1.48])
    np.testing.assert_array_equal(first.scan.ranges_m, [1.0, 2.0, math.inf])
    assert (first.scan.x_m, first.scan.y_m) == pytest.approx(
        (0.1 * math.cos(0.3), -0.1 * math.sin(0.3))
    )
    assert (second.odometry.x_m, second.odometry.y_m) == (1.0, 0.2)
    assert second.reference.x_m == pytest.approx(1.0)


def test_a_robot_laser_line_of_the_first_versions_has_no_number_of_remissions(tmp_path):
    head = "ROBOTLASER1 0 -1.5 3.0 0.01 30.0 0.01 0 2 1.5 2.5"
    line = f"{head} 1 2 0.5 1 2 0.5 0.1 0.2 0.3 0.4 0.5 7.5 host 7.5"
    entry = read_carmen(log(tmp_path, line)).scans[0]
    assert entry.scan.ranges_m.tolist() == [1.5, 2.5]
    assert entry.scan.stamp_ns == 7_500_000_000


def test_a_gzip_log_reads_as_the_plain_one(tmp_path):
    plain = log(tmp_path, SCAN)
    packed = tmp_path / "drive.log.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    np.testing.assert_array_equal(
        read_recording(plain).scans[0].scan.ranges_m, read_recording(packed).scans[0].scan.ranges_m
    )


def test_a_gzip_log_cut_anywhere_gives_what_is_before_the_cut_and_says_so(tmp_path):
    rng = np.random.default_rng(1)
    lines = [flaser(rng.random(180) + 1.0, (i, 0, 0), (0, i, 0), i) for i in range(30)]
    packed = gzip.compress(log(tmp_path, *lines).read_bytes())
    path = tmp_path / "cut.log.gz"
    path.write_bytes(packed[: len(packed) // 2])
    recording = read_recording(path)
    assert 5 < len(recording.scans) < 25
    assert [scan.odometry.y_m for scan in recording.scans] == list(range(len(recording.scans)))
    assert "cut short" in recording.notes[0]


def test_damaged_gzip_data_are_refused(tmp_path):
    packed = bytearray(gzip.compress(log(tmp_path, *[SCAN] * 20).read_bytes()))
    packed[-6] ^= 255
    path = tmp_path / "bad.log.gz"
    path.write_bytes(packed)
    with pytest.raises(LogFormatError, match=r"bad\.log\.gz:22: the gzip data are damaged"):
        read_recording(path)


@pytest.mark.parametrize("kept", [20, 400, 1100])
def test_a_last_line_that_was_cut_is_left_out_and_this_is_said(tmp_path, kept):
    recording = read_carmen(log(tmp_path, SCAN, SCAN[:kept], end=""))
    assert len(recording.scans) == 1
    assert any(":3: the last line is cut short" in note for note in recording.notes)


def test_a_whole_last_line_without_its_end_counts(tmp_path):
    assert len(read_carmen(log(tmp_path, SCAN, SCAN.replace("12.25", "12.5"), end="")).scans) == 2


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (SCAN.replace("1.02 ", "1.o2 "), r"drive\.log:3: found '1\.o2', a number is needed"),
        (SCAN.replace("1.02 ", ""), r"drive\.log:3: FLASER: found 188 values .* 180 ranges"),
        (SCAN.replace("180", "18O"), r"drive\.log:3: FLASER: number of readings: found '18O'"),
        ("FLASER 0 0 0 0 0 0 0 1 h 1", r"drive\.log:3: FLASER: found 0 readings"),
        ("FLASER", r"drive\.log:3: FLASER: the number of readings is missing"),
        (SCAN.replace(" 2.0 0.5", " nan 0.5"), r"drive\.log:3: FLASER: found .* finite"),
        ("ODOM 1 2", r"drive\.log:3: ODOM: found 2 values"),
        ("PARAM x", r"drive\.log:3: PARAM: a name and a value are needed"),
        ("1.02 1.03", r"drive\.log:3: found '1\.02', allowed are PARAM, ODOM, FLASER"),
        ("ROBOTLASER1 0 0 0 0 0 0 0 2 1 1 0 9", r"drive\.log:3: ROBOTLASER1: found 2 values after"),
    ],
)
def test_a_damaged_line_is_named(tmp_path, line, message):
    with pytest.raises(LogFormatError, match=message):
        read_carmen(log(tmp_path, SCAN, line, SCAN))


def test_a_parameter_that_is_no_number_is_named(tmp_path):
    path = log(tmp_path, "PARAM robot_frontlaser_offset far host 0", SCAN)
    with pytest.raises(LogFormatError, match=r"drive\.log:2: found 'far'"):
        read_carmen(path)


def test_lines_of_unknown_kind_are_counted(tmp_path):
    notes = read_carmen(log(tmp_path, SCAN, "SONAR 1 2 3", "NEFF 9.9", "SONAR 1 2 3")).notes
    assert any("2 lines of unknown kind SONAR" in note for note in notes)
    assert not any("NEFF" in note for note in notes)


def test_a_clock_that_goes_back_is_held_and_counted(tmp_path):
    lines = [flaser(BEAMS, (0, 0, 0), (i, 0, 0), t) for i, t in enumerate([10, 20, 19.5, 30])]
    recording = read_carmen(log(tmp_path, *lines))
    assert [scan.scan.stamp_ns // 10**9 for scan in recording.scans] == [10, 20, 20, 30]
    assert [scan.odometry.x_m for scan in recording.scans] == [0, 1, 2, 3]
    assert any("1 of 4 scans: their clock goes back" in note for note in recording.notes)


def test_odometry_lines_that_a_correcting_program_put_in_without_a_time_are_left_out(tmp_path):
    lines = [odom((1, 0, 0), 1.0), SCAN, odom((9, 9, 9), 0), odom((2, 0, 0), 2.0)]
    assert read_carmen(log(tmp_path, *lines)).odometry.poses[:, 0].tolist() == [1.0, 2.0]


def test_without_odometry_lines_the_scans_have_the_odometry(tmp_path):
    assert read_carmen(log(tmp_path, SCAN)).odometry.poses.tolist() == [[0.1, 0.2, 0.3]]


def test_a_log_without_scans_and_odometry_is_refused(tmp_path):
    with pytest.raises(LogFormatError, match="no scan and no odometry"):
        read_carmen(log(tmp_path, "PARAM a b c 0"))


@pytest.mark.recordings("carmen/intel-odometry.log.gz", "carmen/freiburg-079-corrected.log.gz")
def test_public_recordings_are_read_whole(recordings):
    intel = read_recording(recordings / "carmen" / "intel-odometry.log.gz")
    assert len(intel.scans) == len(intel.odometry.poses) == 910
    way = np.diff([(scan.reference.x_m, scan.reference.y_m) for scan in intel.scans], axis=0)
    assert np.hypot(*way.T).sum() == pytest.approx(499.6, abs=0.1)
    freiburg = read_recording(recordings / "carmen" / "freiburg-079-corrected.log.gz")
    assert len(freiburg.scans) == 4791
    assert freiburg.scans[0].scan.x_m == -0.04


@pytest.mark.parametrize("head", ["PARAM robot_front_laser_max {} host 0", ""])
def test_a_reach_beyond_which_many_echoes_lie_is_not_believed(tmp_path, head):
    ranges = [*np.linspace(1.0, 20.0, 150).round(3), *[50.0] * 31]
    if head:
        lines = [head.format(10), flaser(ranges, (0, 0, 0), (1, 0, 0), 1.0)]
    else:
        reach = "0 -1.5 3.0 0.01 10.0 0.01 0"
        lines = [robot_laser(ranges, (0, 0, 0), (1, 0, 0), 1.0, head=reach)]
    recording = read_carmen(log(tmp_path, *lines))
    scan = recording.scans[0].scan
    assert scan.max_range_m == 50.0
    assert np.isfinite(scan.ranges_m[:150]).all()
    assert np.isinf(scan.ranges_m[150:]).all()
    assert any("reach of 10 m, but 53% of the echoes" in note for note in recording.notes)
    told = read_carmen(log(tmp_path, *lines), max_range_m=15.0).scans[0].scan
    assert told.max_range_m == 15.0
    np.testing.assert_array_equal(np.isinf(told.ranges_m), np.array(ranges) >= 15.0)


@pytest.mark.recordings("carmen/acapulco-odometry.log.gz", "carmen/fhw-odometry.log.gz")
def test_the_codes_of_public_recordings_are_found(recordings):
    for name, reach, count in (("acapulco", 50.0, 13_213), ("fhw", 51.05, 647)):
        recording = read_recording(recordings / "carmen" / f"{name}-odometry.log.gz")
        assert {entry.scan.max_range_m for entry in recording.scans} == {reach}
        none = sum(int(np.isinf(entry.scan.ranges_m).sum()) for entry in recording.scans)
        assert none == pytest.approx(count, abs=5)


def as_recorded(offset_m=0.0, odometry_at=0.0, corrected=(), kind=flaser):
    """Lines of a log with one pose for each scan, and ODOM lines so far to its left [m]."""
    lines = [f"PARAM robot_frontlaser_offset {offset_m} host 0"]
    for i in range(20):
        pose, time_s = (0.3 * i, 0.0, 0.0), 10.0 + i
        lines.append(odom((pose[0], odometry_at, 0.0), time_s - 0.01))
        lines.append(kind(BEAMS, (pose[0] + offset_m, 0.0, 0.0), pose, time_s))
    return [*lines, odom((6.0, odometry_at, 0.0), 31.0), *corrected]


@pytest.mark.parametrize("kind", [flaser, robot_laser])
@pytest.mark.parametrize("offset_m", [0.0, 0.2])
def test_a_log_as_it_was_recorded_has_no_reference_and_this_is_said(tmp_path, offset_m, kind):
    recording = read_carmen(log(tmp_path, *as_recorded(offset_m, kind=kind)))
    assert recording.reference is None
    assert [entry.reference for entry in recording.scans] == [None] * 20
    assert [entry.odometry.x_m for entry in recording.scans] == pytest.approx(0.3 * np.arange(20))
    assert any("has no reference" in note for note in recording.notes)


@pytest.mark.parametrize(
    "lines",
    [
        as_recorded(corrected=["NEFF 0.9 1 host 1"]),
        as_recorded(corrected=[odom((1, 2, 3), 0.0)]),
        as_recorded(odometry_at=1.0),
        [line for line in as_recorded() if "ODOM" not in line],
    ],
)
def test_a_log_that_was_corrected_in_place_has_one(tmp_path, lines):
    recording = read_carmen(log(tmp_path, *lines))
    assert recording.reference.poses[:, 0] == pytest.approx(0.3 * np.arange(20))


def test_a_laser_that_never_moves_is_no_reference(tmp_path):
    lines = [flaser(BEAMS, (0, 0, 0), (0.3 * i, 0, 0), 10.0 + i) for i in range(20)]
    recording = read_carmen(log(tmp_path, *lines))
    assert recording.reference is None
    assert any("the laser's pose is the same in all lines" in note for note in recording.notes)


@pytest.mark.recordings("carmen/intel-odometry.log.gz", "carmen/seattle-corrected.log.gz")
def test_where_the_robot_comes_by_again_scans_tell_a_raw_log_from_a_corrected_one(
    recordings, tmp_path
):
    lines = []
    with gzip.open(recordings / "carmen" / "intel-odometry.log.gz", "rt") as file:
        for line in file:
            words = line.split()
            if words[0] == "FLASER":
                words[-9:-6] = words[-6:-3]
                lines.append(" ".join(words))
    (tmp_path / "raw.log").write_text("\n".join(lines) + "\n")
    recording = read_recording(tmp_path / "raw.log")
    assert recording.reference is None
    assert any("a log as it was recorded" in note for note in recording.notes)
    corrected = read_recording(recordings / "carmen" / "seattle-corrected.log.gz")
    assert corrected.reference is not None
