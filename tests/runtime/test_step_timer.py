"""Times of the parts of a step, by a clock that the test sets."""

import pytest

from robotctl.runtime.step_timer import StepTimer

MS = 1_000_000


class Steps:
    """A timer of steps of 50 ms, and its clock."""

    def __init__(self) -> None:
        self.now_ns = 7 * MS
        self.timer = StepTimer(50 * MS, lambda: self.now_ns)

    def step(self, *laps: tuple[str, float]) -> None:
        """Step, with what is over after each time [ms]."""
        self.now_ns += 9 * MS  # asleep
        self.timer.begin()
        for part, ms in laps:
            self.now_ns += round(ms * MS)
            self.timer.lap(part)
        self.timer.end()


def test_before_the_first_step_there_are_no_times() -> None:
    budget = Steps().timer.budget()
    assert (budget.period_ms, budget.steps, budget.p50_ms, budget.parts_p50_ms) == (50, 0, 0, {})


def test_a_part_has_the_time_since_the_one_before_also_in_two_pieces() -> None:
    steps = Steps()
    steps.step(("see", 2.0), ("plan", 3.0), ("see", 4.0))
    budget = steps.timer.budget()
    assert budget.parts_p50_ms == {"see": 6.0, "plan": 3.0}
    assert budget.p50_ms == budget.p99_ms == 9.0


def test_percentiles_are_values_that_so_many_steps_do_not_exceed() -> None:
    steps = Steps()
    for ms in range(1, 101):
        steps.step(("steer", ms), *([("plan", 10.0)] if ms == 100 else []))
    budget = steps.timer.budget()
    assert (budget.p50_ms, budget.p99_ms) == (50.0, 99.0)
    assert (budget.parts_p50_ms["plan"], budget.parts_p99_ms["plan"]) == (0.0, 0.0)
    assert (budget.steps, budget.late) == (100, 50)


@pytest.mark.parametrize("count", [199, 200])
def test_what_was_200_steps_ago_does_not_count(count: int) -> None:
    steps = Steps()
    steps.step(("plan", 1000.0))
    for _ in range(count):
        steps.step(("steer", 1.0))
    budget = steps.timer.budget()
    assert ("plan" in budget.parts_p50_ms) == (count < 200)
    assert budget.late == 1


def efforts(steps: Steps, count: int, *laps: tuple[str, float]) -> list[float]:
    """Return the effort after each of so many equal steps."""
    found = []
    for _ in range(count):
        steps.step(*laps)
        found.append(steps.timer.effort)
    return found


def test_the_effort_is_halved_each_second_while_one_step_in_ten_is_crowded() -> None:
    steps = Steps()
    assert efforts(steps, 18, ("steer", 39.0)) == [1.0] * 18
    assert efforts(steps, 2, ("steer", 41.0)) == [1.0, 0.5]
    assert efforts(steps, 60, ("steer", 41.0))[19::20] == [0.25, 0.125, 0.125]
    assert steps.timer.budget().effort == 0.125


def test_one_crowded_step_in_a_second_and_plans_and_what_does_not_steer_save_no_effort() -> None:
    steps = Steps()
    for _ in range(10):
        assert (
            efforts(steps, 19, ("steer", 10.0)) + efforts(steps, 1, ("steer", 99.0)) == [1.0] * 20
        )
    assert set(efforts(steps, 40, ("plan", 150.0), ("steer", 10.0))) == {1.0}
    assert set(efforts(steps, 40, ("localise", 90.0))) == {1.0}


def test_the_effort_returns_after_ten_seconds_that_would_bear_twice_the_work() -> None:
    steps = Steps()
    efforts(steps, 40, ("steer", 45.0))
    assert steps.timer.effort == 0.25
    assert efforts(steps, 400, ("steer", 17.0))[199::200] == [0.5, 1.0]
    efforts(steps, 20, ("steer", 45.0))
    assert set(efforts(steps, 400, ("steer", 18.0))) == {0.5}
