"""Frames that were held back, told by the drive's time and the host's."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.messages.actuators import ActuatorFeedback
from robotctl.safety.stale_frame_filter import Latch, LatchTimes

MS = 1_000_000
ROLLOVER_MS = 1048.576


def frame(arrived_ms: float, latched_ms: float) -> ActuatorFeedback:
    return ActuatorFeedback(round(arrived_ms * MS), round(latched_ms * 1000) & 0xFFFFF)


def judged(*frames: ActuatorFeedback) -> list[Latch]:
    latches = LatchTimes()
    return [latches.judge(each) for each in frames]


@given(
    st.floats(0, 10_000),
    st.lists(st.tuples(st.floats(1, 400), st.floats(0, 9), st.floats(-0.02, 0.02)), max_size=40),
)
def test_frames_that_come_as_they_were_latched_go_on(drive_ms, steps) -> None:
    """Whatever the clocks began at, with up to 9 ms on the bus and clocks 2 % apart."""
    latched_ms, arrived_ms = drive_ms, 0.0
    latches = LatchTimes()
    for step_ms, waited_ms, share in steps:
        arrived_ms += step_ms
        latched_ms += step_ms * (1 + share)
        assert latches.judge(frame(arrived_ms + waited_ms, latched_ms)) is Latch.NEXT


@given(st.floats(30, 5000))
def test_a_frame_of_long_before_is_held_back_and_those_of_now_go_on(age_ms) -> None:
    frames = [frame(each, 100 + each) for each in range(0, 6000, 5)]
    late = frame(5998, 100 + 5998 - age_ms)
    latches = LatchTimes()
    for each in frames:
        assert latches.judge(each) is Latch.NEXT
    rolled_ms = (age_ms + ROLLOVER_MS / 2) % ROLLOVER_MS - ROLLOVER_MS / 2
    seen = abs(rolled_ms) > 24
    if seen:
        assert latches.judge(late) is Latch.HELD_BACK
        assert latches.judge(frame(6000, 6100)) is Latch.NEXT


@pytest.mark.parametrize(("off_ms", "latch"), [(20, Latch.NEXT), (20.001, Latch.HELD_BACK)])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_tolerance_is_20_ms(off_ms, latch, sign) -> None:
    assert judged(frame(1000, 500), frame(1100, 600 + sign * off_ms))[1] is latch


def test_a_drive_whose_time_has_changed_for_good_is_believed_with_its_second_frame() -> None:
    frames = (frame(0, 0), frame(5, 305), frame(10, 310), frame(15, 315))
    assert judged(*frames) == [Latch.NEXT, Latch.HELD_BACK, Latch.ANEW, Latch.NEXT]


def test_frames_held_back_between_those_of_now_are_never_believed() -> None:
    now = [frame(each, each) for each in range(1000, 1200, 5)]
    old = [frame(each + 1, each - 800) for each in range(1000, 1200, 5)]
    mixed = [each for pair in zip(now, old, strict=True) for each in pair]
    assert judged(*mixed) == [Latch.NEXT, Latch.HELD_BACK] * len(now)


@pytest.mark.parametrize(("gap_ms", "latch"), [(500, Latch.NEXT), (500.001, Latch.ANEW)])
def test_behind_half_a_second_the_time_between_is_not_known(gap_ms, latch) -> None:
    assert judged(frame(0, 0), frame(gap_ms, gap_ms))[1] is latch


def test_after_a_reset_any_time_will_do() -> None:
    latches = LatchTimes()
    latches.judge(frame(0, 0))
    latches.reset()
    assert latches.judge(frame(5, 700)) is Latch.NEXT
