"""Where readings were taken, against the closed form of a drive, and where that is not known."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.logs.formats.log_text import LogFormatError
from robotctl.logs.formats.placing import Odometry, trajectory
from robotctl.logs.formats.timeline import Series

SECOND = 10**9
NO_LOG = np.empty(0, np.int64)
LOG = Path("drive")


def series(what, times_s, values, log_s=None):
    log_ns = NO_LOG if log_s is None else np.rint(np.array(log_s) * 1e9).astype(np.int64)
    stamps_ns = np.rint(np.array(times_s) * 1e9).astype(np.int64)
    return Series(what, stamps_ns, log_ns, list(values), np.zeros(len(stamps_ns), bool))


def circle(time_s):
    """Where a robot is that drives a circle of 1 m at 0.5 m/s."""
    angle = 0.5 * time_s
    return math.sin(angle), 1.0 - math.cos(angle), angle


def driven(times_s, notes, **options):
    return Odometry(LOG, series("poses", times_s, map(circle, times_s), **options), notes)


@given(st.lists(st.floats(-2.0, 12.0).map(lambda s: round(s, 6)), max_size=20).map(sorted))
def test_readings_have_the_pose_of_their_time_and_none_outside(times_s):
    notes = []
    odometry = driven(np.arange(0.0, 10.05, 0.1), notes)
    placed = odometry.place(series("scans", times_s, times_s))
    inside = [time_s for time_s in times_s if 0.0 <= time_s <= 10.0]
    assert [value for _, value, _ in placed] == inside
    for stamp_ns, time_s, pose in placed:
        assert stamp_ns == round(time_s * 1e9)
        x, y, theta = circle(time_s)
        # Chords of 0.05 m stand for the arcs.
        assert (pose.x_m, pose.y_m) == pytest.approx((x, y), abs=5e-4)
        assert math.remainder(pose.theta_rad - theta, math.tau) == pytest.approx(0.0, abs=1e-6)
    out = [max(-time_s, time_s - 10.0) for time_s in times_s if not 0.0 <= time_s <= 10.0]
    if out:
        (note,) = notes
        assert note.startswith(f"{len(out)} of {len(times_s)} scans left out: they lie outside of")
        assert note.endswith(f"odometry, 0 s to 10 s, by up to {max(out):.3f} s")
    else:
        assert notes == []


@given(st.integers(5, 40), st.integers(12, 50))
def test_readings_while_a_moving_robot_says_nothing_are_left_out(begin, length):
    times_s = [0.1 * i for i in range(101) if not begin < i < begin + length]
    notes = []
    odometry = driven(times_s, notes)
    readings_s = 0.05 + 0.1 * np.arange(100)
    placed = odometry.place(series("scans", readings_s, readings_s))
    lost = readings_s[(readings_s > 0.1 * begin) & (readings_s < 0.1 * (begin + length))]
    assert len(lost) == length
    assert {value for _, value, _ in placed} == set(readings_s) - set(lost)
    assert f"{length} of 100 scans left out: the odometry says nothing meanwhile" in notes[0]


def test_a_robot_that_stands_need_not_say_so():
    times_s = [0.0, 0.1, 0.2, 30.0, 30.1]
    odometry = Odometry(LOG, series("poses", times_s, [(1.0, 2.0, 0.5)] * 5), [])
    ((_, _, pose),) = odometry.place(series("scans", [15.0], "a"))
    assert (pose.x_m, pose.y_m, pose.theta_rad) == (1.0, 2.0, 0.5)


@pytest.mark.parametrize("ahead_s", [-1e6, -0.6, 0.6, 3600.0])
def test_readings_of_another_clock_are_left_out_by_how_far_it_is_off(ahead_s):
    times_s = np.arange(0.0, 10.0, 0.1)
    notes = []
    odometry = driven(times_s, notes, log_s=1e6 + times_s)
    assert (
        odometry.place(series("scans", 5.0 + times_s + ahead_s, times_s, 1e6 + 5.0 + times_s)) == []
    )
    side = "ahead of" if ahead_s > 0.0 else "behind"
    assert f"100 of 100 scans left out: their clock is {abs(ahead_s):.3f} s {side} that" in notes[0]


def test_a_log_that_received_at_another_pace_does_not_make_another_clock():
    times_s = np.arange(0.0, 10.0, 0.1)
    odometry = driven(times_s, [], log_s=1e6 + 3.0 * times_s)
    assert len(odometry.place(series("scans", times_s, times_s, 1e6 + 3.0 * times_s + 0.2))) == 100


def test_times_that_a_program_put_in_the_log_make_no_other_clock():
    times_s = np.arange(0.0, 10.0, 0.1)
    odometry = driven(times_s, [], log_s=np.full(100, 5.0))
    assert len(odometry.place(series("scans", times_s, times_s, np.full(100, 5.0)))) == 100


def test_what_is_no_pose_is_left_out():
    rows = [
        (0.0, 0.0, 0.0),
        (math.nan, 0.0, 0.0),
        (0.0, 1e300, 0.0),
        (0.2, 0.0, math.inf),
        (0.3, 0, 0),
    ]
    notes = []
    known, can_be = trajectory(series("poses", range(5), rows), notes)
    assert can_be.tolist() == [True, False, False, False, True]
    assert known.stamps_ns.tolist() == [0, 4 * SECOND]
    assert notes == [
        "3 of 5 poses left out: they are no poses; the first, at 1 s, is nan m, 0 m, 0 rad"
    ]
    assert trajectory(series("poses", [0], [(math.nan, 0.0, 0.0)]), []) is None
    with pytest.raises(LogFormatError, match="drive: no poses of use in it; 1 of 1 poses left out"):
        Odometry(LOG, series("poses", [0], [(math.nan, 0.0, 0.0)]), [])


def test_the_longest_part_without_a_jump_counts_and_not_what_is_near_the_jump():
    times_s = 0.1 * np.arange(100)
    rows = [(x if x < 3.0 else x + 9.0, 0.0, 0.0) for x in (0.05 * np.arange(100)).tolist()]
    notes = []
    odometry = Odometry(LOG, series("poses", times_s, rows), notes)
    known_s = 1e-9 * odometry.trajectory.stamps_ns[[0, -1]]
    assert known_s == pytest.approx([0.0, 5.5])
    assert odometry.rows.tolist() == list(range(56))
    (note,) = notes
    assert note.startswith(
        "poses: the robot jumps 1 time, first at 6 s by 9.05 m within 0.100 s; the"
    )
    assert note.endswith("longest part without is read, 44 of 100 poses are left out")


def test_a_fast_robot_does_not_jump():
    times_s = np.arange(0.0, 20.0, 0.2)
    odometry = Odometry(LOG, series("poses", times_s, [(22.0 * t, 0.0, 0.0) for t in times_s]), [])
    assert len(odometry.trajectory.poses) == 100


def test_a_frame_that_begins_anew_elsewhere_is_a_jump_however_long_that_took():
    times_s = [*range(10), *range(100, 106)]
    rows = [(0.1 * i, 0.0, 0.0) for i in range(10)] + [(0.1 * i, 0.0, 0.0) for i in range(6)]
    begins = np.arange(16) == 10
    assert len(Odometry(LOG, series("poses", times_s, rows), [], begins).trajectory.poses) == 10
    on = [(0.1 * i, 0.0, 0.0) for i in range(16)]
    assert len(Odometry(LOG, series("poses", times_s, on), [], begins).trajectory.poses) == 16


def test_poses_of_two_robots_in_turn_are_refused():
    rows = [(0.01 * i, 5.0 * (i % 2), 0.0) for i in range(100)]
    with pytest.raises(
        LogFormatError,
        match=r"drive: poses: the robot jumps 99 times in 100 poses, .* of several robots",
    ):
        Odometry(LOG, series("poses", 0.02 * np.arange(100), rows), [])
