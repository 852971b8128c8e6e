"""The fixed-rate loop: absolute deadlines, statistics, and a stated policy for overruns.

Policy: a tick that ends after later deadlines skips them and waits for the next on the original
grid. It never catches up in a burst, since two commands in a row would act on one measurement. Each
skipped deadline counts as one overrun, attributed to the longest stage.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from typing import Protocol

from robotctl.messages.control import LoopStatistics
from robotctl.messages.ports import Clock
from robotctl.runtime.histogram import Histogram

STAGES = ("receive", "control", "send", "publish")
SCHEDULER = "scheduler"


class Ticker(Protocol):
    """The work of one period, split into the stages of `STAGES` to attribute overruns.

    `receive` gets the time of the wake-up. The other stages get the time of its end, by which ages
    are judged, so that a pause of the process while receiving counts, too.
    """

    def receive(self, now_ns: int) -> None:
        """Receive the inputs."""

    def control(self, now_ns: int) -> None:
        """Compute the outputs."""

    def send(self, now_ns: int) -> None:
        """Send the outputs."""

    def publish(self, now_ns: int) -> None:
        """Publish to other processes, after everything urgent."""


class Loop:
    """Runs a `Ticker` at a fixed rate.

    Parameters
    ----------
    clock
        Source of time and sleep.
    period_ns
        Period [ns].
    """

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self.period_ns = period_ns
        self.ticks = 0
        self.overruns = 0
        self.blame = dict.fromkeys((*STAGES, SCHEDULER), 0)
        self.lag_ns = self.step_ns = 0
        """Wake-up latency after the deadline, and time from wake-up to send, of this tick [ns]."""
        self.lag = Histogram()
        self.step = Histogram()
        self.stages = {stage: Histogram() for stage in STAGES}
        self._clock = clock
        self._histograms = {"lag": self.lag, "step": self.step, **self.stages}
        self._figures = dict.fromkeys(self._histograms, (0.0, 0.0, 0.0))
        self._next_figure = cycle(self._histograms)

    def run(self, ticker: Ticker, stopped: Callable[[], bool]) -> None:
        """Tick until `stopped()`; the first deadline is one period from now."""
        deadline_ns = self._clock.now_ns() + self.period_ns
        while not stopped():
            self._clock.sleep_until(deadline_ns)
            deadline_ns = self.tick(ticker, deadline_ns)

    def tick(self, ticker: Ticker, deadline_ns: int) -> int:
        """Do the work due at `deadline_ns` and return the next deadline."""
        now = self._clock.now_ns
        woken_ns = now()
        ticker.receive(woken_ns)
        received_ns = now()
        ticker.control(received_ns)
        controlled_ns = now()
        ticker.send(received_ns)
        sent_ns = now()
        self.lag_ns = lag_ns = woken_ns - deadline_ns
        self.step_ns = step_ns = sent_ns - woken_ns
        # After the command is sent, so that publishing delays no command.
        ticker.publish(received_ns)
        done_ns = now()
        self.ticks += 1
        # The histograms count tenths of a microsecond.
        self.lag.add(lag_ns // 100)
        self.step.add(step_ns // 100)
        durations = (
            received_ns - woken_ns,
            controlled_ns - received_ns,
            sent_ns - controlled_ns,
            done_ns - sent_ns,
        )
        for histogram, duration_ns in zip(self.stages.values(), durations, strict=True):
            histogram.add(duration_ns // 100)
        deadline_ns += self.period_ns
        # Never catch up in a burst: two commands in a row would act on one measurement.
        if done_ns >= deadline_ns:
            deadline_ns = self._skip(deadline_ns, done_ns, lag_ns, durations)
        return deadline_ns

    def _skip(self, deadline_ns: int, now_ns: int, lag_ns: int, durations: tuple[int, ...]) -> int:
        """Count the deadlines missed at `now_ns` and return the first one after it."""
        missed = (now_ns - deadline_ns) // self.period_ns + 1
        self.overruns += missed
        longest = max(durations)
        cause = SCHEDULER if lag_ns > longest else STAGES[durations.index(longest)]
        self.blame[cause] += missed
        return deadline_ns + missed * self.period_ns

    def refresh(self, *, whole: bool = False) -> None:
        """Bring the percentiles of one stage, in turn, or of the `whole` loop up to date.

        One at a time, so that publishing costs about 10 us per tick, not 60.
        """
        for name in self._histograms if whole else (next(self._next_figure),):
            p50, p99, p999 = self._histograms[name].percentiles(0.5, 0.99, 0.999)
            self._figures[name] = (p50 / 10, p99 / 10, p999 / 10)

    def statistics(self) -> LoopStatistics:
        """Return the figures since the start, as of the last `refresh`."""
        figures = self._figures
        lag_us_p50, lag_us_p99, lag_us_p999 = figures["lag"]
        return LoopStatistics(
            rate_hz=1e9 / self.period_ns,
            ticks=self.ticks,
            overruns=self.overruns,
            lag_us_p50=lag_us_p50,
            lag_us_p99=lag_us_p99,
            lag_us_p999=lag_us_p999,
            lag_us_max=self.lag.maximum / 10,
            step_us_p50=figures["step"][0],
            step_us_p99=figures["step"][1],
            overrun_causes={cause: count for cause, count in self.blame.items() if count},
            stage_us_p50={stage: figures[stage][0] for stage in STAGES},
            stage_us_p99={stage: figures[stage][1] for stage in STAGES},
        )
