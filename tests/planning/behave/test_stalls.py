"""When a held-up navigation lets the robot go on by itself, and when it gives up."""

import pytest

from robotctl.planning.behave.stalls import GAP_NS, HEALTHY_NS, LONGEST_NS, WITHIN_NS, StallWatch

PERIOD_NS = 50_000_000


class Steps:
    """A navigation whose steps are told of one after the other."""

    def __init__(self):
        self.watch = StallWatch()
        self.now_ns = 10**12
        self.told = []

    def step(self, gap_ns=PERIOD_NS, late_ns=0, *, heard=True):
        self.now_ns += gap_ns
        stall = self.watch.step(self.now_ns, late_ns, control_is_fresh=heard)
        self.told += [self.watch.over] if self.watch.over else []
        return stall

    def well(self, seconds):
        """Return whether the robot might have driven in each step of a time without trouble."""
        return [self.step() is None for _ in range(round(seconds * 1e9) // PERIOD_NS)]


@pytest.fixture
def steps():
    made = Steps()
    assert all(made.well(2.0))
    return made


def test_a_navigation_that_never_heard_control_is_not_held_up():
    made = Steps()
    assert [made.step(heard=False) for _ in range(300)] == [None] * 300
    assert made.told == []


@pytest.mark.parametrize("gap_ns", [GAP_NS + 1, LONGEST_NS])
def test_a_stall_ends_after_a_second_in_step_and_is_told(steps, gap_ns):
    stall = steps.step(gap_ns)
    assert not stall.ends_mode
    drives = steps.well(2.0)
    assert drives.index(True) == HEALTHY_NS // PERIOD_NS
    assert all(drives[drives.index(True) :])
    (told,) = steps.told
    assert told.endswith("; the robot goes on")


def test_a_longer_stall_ends_the_mode(steps):
    assert steps.step(LONGEST_NS + PERIOD_NS).ends_mode


def test_silence_of_control_ends_the_mode_as_soon_as_it_is_too_long(steps):
    silent = [steps.step(heard=False) for _ in range(LONGEST_NS // PERIOD_NS + 2)]
    assert [each.ends_mode for each in silent].index(True) == LONGEST_NS // PERIOD_NS
    assert silent[-1].words.startswith("no messages from control for 5.")


def test_trouble_within_the_second_is_part_of_the_same_stall(steps):
    steps.step(3_200_000_000)
    steps.well(0.5)
    assert not steps.step(heard=False).ends_mode
    steps.well(0.9)
    assert steps.step(GAP_NS + 1).ends_mode  # 3.2 + 0.5 + 0.9 + 0.5 s


@pytest.mark.parametrize("apart_ns", [WITHIN_NS // 2 - 4_000_000_000, WITHIN_NS // 2])
def test_the_third_stall_within_a_minute_ends_the_mode(steps, apart_ns):
    for number in range(3):
        stall = steps.step(600_000_000)
        if number < 2:
            assert not stall.ends_mode
            steps.well(apart_ns / 1e9)
    assert stall.ends_mode == (apart_ns < WITHIN_NS // 2)
    assert ("3 times within a minute" in stall.words) == stall.ends_mode


def test_the_cause_is_the_process_own_measure(steps):
    assert steps.step(2_000_000_000, 1_900_000_000).words.startswith(
        "navigation was held up (kept from the processor, or stopped) for 2.0 s"
    )
    steps.well(2.0)
    assert steps.step(900_000_000, 10_000_000).words.startswith(
        "navigation was held up (a step took that long)"
    )


def test_messages_missed_right_behind_a_late_step_are_not_blamed_on_control(steps):
    steps.step(300_000_000, 250_000_000)
    assert steps.step(heard=False).words.startswith(
        "navigation was kept from the processor (250 ms late)"
    )
