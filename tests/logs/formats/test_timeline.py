"""What a log says in the order of one clock: laws, and what is done to each kind of wrong time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.logs.formats.timeline import Timeline

SECOND = 10**9
TIMES = st.lists(
    st.one_of(st.integers(0, 40), st.integers(0, 10**6)).map(lambda s: s * SECOND // 20),
    max_size=40,
)


def settled(times_ns, **options):
    """Return what counts of entries with these times, by their numbers, and the notes."""
    notes = []
    timeline = Timeline(notes, **options)
    for number, stamp_ns in enumerate(times_ns):
        timeline.add("scans", stamp_ns, number, number)
    return timeline.settled().get("scans"), notes


@given(TIMES)
def test_times_never_go_back_and_entries_stay_in_the_order_of_the_log(times_ns):
    series, notes = settled(times_ns)
    if series is None:
        assert times_ns == []
        return
    assert (np.diff(series.stamps_ns) >= 0).all()
    assert series.values == sorted(set(series.values))
    # No time is moved on by more than what a clock may go back without having been set.
    moved_ns = series.stamps_ns - np.array(times_ns)[series.values]
    assert ((moved_ns >= 0) & (moved_ns <= SECOND // 10)).all()
    assert (len(series) == len(times_ns)) or any("left out" in note for note in notes)


@given(TIMES.map(sorted).filter(lambda times: times and times[-1] - times[0] < 10**5 * SECOND))
def test_what_goes_forward_is_left_as_it_is(times_ns):
    series, notes = settled(times_ns)
    assert series.stamps_ns.tolist() == times_ns
    assert series.values == list(range(len(times_ns)))
    assert all("one time" in note for note in notes)


@given(st.integers(2, 30), st.integers(2, 30), st.integers(2, 1000))
def test_of_a_clock_that_is_set_back_the_longer_part_is_kept(first, second, back):
    times_ns = [i * SECOND for i in range(first)]
    times_ns += [times_ns[-1] - back * SECOND + i * SECOND // 2 for i in range(second)]
    times_ns = [each + 5000 * SECOND for each in times_ns]
    series, notes = settled(times_ns)
    kept = range(first) if first >= second else range(first, first + second)
    assert series.values == list(kept)
    assert notes[0] == (f"scans: their clock is set back by {back}.000 s at {5000 + first - 1} s")
    left_out = first + second - len(kept)
    assert f"left out are {left_out} of {first + second} scans" in notes[1]


@pytest.mark.parametrize("at", [1, 5, 8])
@pytest.mark.parametrize("away_s", [-3, 3, 10**9])
def test_a_single_time_far_from_its_neighbours_is_left_out(at, away_s):
    times_ns = [i * SECOND // 10 for i in range(10)]
    times_ns[at] += away_s * SECOND
    series, notes = settled(times_ns)
    assert series.values == [i for i in range(10) if i != at]
    (note,) = notes
    assert note.startswith(
        "1 of 10 scans left out: their time is far from that of their neighbours"
    )
    assert note.endswith(f"after {(at - 1) / 10:.15g} s follows first {1e-9 * times_ns[at]:.15g} s")


def test_a_time_that_goes_back_a_little_is_held():
    series, notes = settled([0, SECOND, SECOND - 10**7, 2 * SECOND])
    assert series.stamps_ns.tolist() == [0, SECOND, SECOND, 2 * SECOND]
    assert notes == ["1 of 4 scans: their clock goes back, time held"]


def test_what_is_repeated_counts_once_wherever_it_stands():
    notes = []
    timeline = Timeline(notes)
    for stamp_ns, text in ((0, "a"), (SECOND, "b"), (0, "a"), (SECOND, "c"), (SECOND, "b")):
        timeline.add("lines", stamp_ns, text, text)
    assert timeline.settled()["lines"].values == ["a", "b", "c"]
    assert notes == ["2 of 5 lines repeat an earlier one, left out"]


def test_the_stretch_of_one_source_is_that_of_all():
    """Only the lidar's clock is set: odometry of the same times would be that of other places."""
    notes = []
    timeline = Timeline(notes)
    for i in range(20):
        timeline.add("poses", i * SECOND, i, i)
        timeline.add("scans", (i if i < 12 else i - 5) * SECOND, i, i)
        timeline.add("details", (i if i < 12 else i - 5) * SECOND, i, i)
        timeline.add("static", 0, i, i)
    found = timeline.settled(details=["details"], timeless=["static"])
    assert found["scans"].values == list(range(12))
    assert found["poses"].values == list(range(13))
    assert found["details"].values == list(range(12))
    assert found["static"].values == list(range(20))
    assert "left out are 7 of 20 poses, 8 of 20 scans" in notes[-1]


def test_entries_that_cannot_be_are_counted_with_reasons_and_the_first_time():
    notes = []
    timeline = Timeline(notes)
    timeline.add("scans", 0, "a", "a")
    for stamp_ns, reason in ((2 * SECOND, "no ranges"), (3 * SECOND, "nan"), (4 * SECOND, "nan")):
        timeline.leave_out("scans", stamp_ns, reason)
    timeline.add("scans", 10**19, "z", "z")
    assert timeline.settled()["scans"].values == ["a"]
    (note,) = notes
    assert note.startswith(
        "4 of 5 scans left out: no ranges, nan, the time is before 1969 or after"
    )
    assert note.endswith("; the first at 2 s")


def test_files_of_their_own_have_stretches_of_their_own():
    notes = []
    timeline = Timeline(notes)
    timeline.add_file("a", [0, 10 * SECOND, 20 * SECOND, 2 * SECOND, 3 * SECOND], "abcde")
    timeline.add_file("b", [0, SECOND], "fg")
    found = timeline.settled()
    assert found["a"].values == ["a", "b", "c"]
    assert found["b"].values == ["f", "g"]
