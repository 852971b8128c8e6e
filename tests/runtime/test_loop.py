"""The loop on a clock that the test moves."""

from collections.abc import Callable
from typing import ClassVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.runtime.clock import RealClock, VirtualClock
from robotctl.runtime.loop import Loop

PERIOD_NS = 5_000_000


class Work:
    """A ticker whose stages take the times it is given."""

    def __init__(self, clock: VirtualClock, cost_ns: Callable[[int, str], int]) -> None:
        self.started_ns: list[int] = []
        self._clock = clock
        self._cost_ns = cost_ns

    def _spend(self, stage: str) -> None:
        tick = len(self.started_ns)
        self._clock.sleep_until(self._clock.now_ns() + self._cost_ns(tick, stage))

    def receive(self, now_ns: int) -> None:
        self.started_ns.append(now_ns)
        self._spend("receive")

    def control(self, now_ns: int) -> None:
        self._spend("control")

    def send(self, now_ns: int) -> None:
        self._spend("send")

    def publish(self, now_ns: int) -> None:
        self._spend("publish")


def run(ticks: int, cost_ns: Callable[[int, str], int]) -> tuple[Loop, Work]:
    clock = VirtualClock()
    loop, work = Loop(clock, PERIOD_NS), Work(clock, cost_ns)
    loop.run(work, lambda: loop.ticks >= ticks)
    return loop, work


def test_ticks_stand_on_an_absolute_grid_however_long_the_work_takes() -> None:
    loop, work = run(100, lambda tick, stage: 1000 * tick)
    assert work.started_ns == [PERIOD_NS * (i + 1) for i in range(100)]
    assert loop.overruns == 0


def test_the_stages_after_receiving_are_given_the_time_at_which_it_had_ended() -> None:
    pause_ns = 3 * PERIOD_NS // 4
    clock = VirtualClock()

    class Noting(Work):
        given_ns: ClassVar[dict[str, int]] = {}

        def receive(self, now_ns: int) -> None:
            self.given_ns["receive"] = now_ns
            super().receive(now_ns)

        def control(self, now_ns: int) -> None:
            self.given_ns["control"] = now_ns
            super().control(now_ns)

        def send(self, now_ns: int) -> None:
            self.given_ns["send"] = now_ns

        def publish(self, now_ns: int) -> None:
            self.given_ns["publish"] = now_ns

    costs_ns = {"receive": pause_ns, "control": 1000}
    work = Noting(clock, lambda tick, stage: costs_ns[stage])
    loop = Loop(clock, PERIOD_NS)
    clock.sleep_until(PERIOD_NS)
    loop.tick(work, PERIOD_NS)
    received_ns = PERIOD_NS + pause_ns
    told = dict.fromkeys(("control", "send", "publish"), received_ns)
    assert work.given_ns == {"receive": PERIOD_NS, **told}


def test_an_overrun_skips_its_deadlines_and_is_blamed_on_the_longest_stage() -> None:
    def cost(tick: int, stage: str) -> int:
        return int(2.5 * PERIOD_NS) if (tick, stage) == (10, "control") else 1000

    loop, work = run(20, cost)
    assert loop.overruns == 2
    assert loop.statistics().overrun_causes == {"control": 2}
    gaps = [b - a for a, b in zip(work.started_ns, work.started_ns[1:], strict=False)]
    assert gaps[9] == 3 * PERIOD_NS
    assert set(gaps[:9] + gaps[10:]) == {PERIOD_NS}


@given(st.lists(st.integers(0, 4 * PERIOD_NS), min_size=1, max_size=50))
def test_no_deadline_is_served_twice_and_none_is_lost_from_the_count(costs: list[int]) -> None:
    loop, work = run(len(costs), lambda tick, stage: costs[tick - 1] if stage == "send" else 0)
    assert all(start % PERIOD_NS == 0 for start in work.started_ns)
    gaps = [b - a for a, b in zip(work.started_ns, work.started_ns[1:], strict=False)]
    assert all(gap >= PERIOD_NS for gap in gaps)
    last_skip = -(-max(costs[-1] - PERIOD_NS + 1, 0) // PERIOD_NS)
    assert sum(gap // PERIOD_NS - 1 for gap in gaps) + last_skip == loop.overruns


def test_a_late_wake_up_is_blamed_on_the_scheduler() -> None:
    clock = VirtualClock()
    loop = Loop(clock, PERIOD_NS)
    clock.sleep_until(2 * PERIOD_NS + 10)
    following = loop.tick(Work(clock, lambda tick, stage: 1), PERIOD_NS)
    assert following == 3 * PERIOD_NS
    assert loop.statistics().overrun_causes == {"scheduler": 1}


def test_lag_and_step_come_out_in_microseconds() -> None:
    loop, _ = run(100, lambda tick, stage: 20_000)
    loop.refresh(whole=True)
    statistics = loop.statistics()
    assert statistics.lag_us_max == 0.0
    assert statistics.step_us_p50 == pytest.approx(60, rel=1 / 32)
    assert statistics.stage_us_p99["publish"] == pytest.approx(20, rel=1 / 32)
    assert statistics.rate_hz == 200


def test_the_real_clock_never_wakes_before_its_deadline() -> None:
    clock = RealClock()
    for step_ns in (0, 10_000, 2_000_000, -5_000_000):
        deadline_ns = clock.now_ns() + step_ns
        clock.sleep_until(deadline_ns)
        assert clock.now_ns() >= deadline_ns
