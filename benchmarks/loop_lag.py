"""Loop lag beside cyclictest, both cores busy, in turn in the same minutes.

cyclictest (Debian rt-tests) does in C what the loop does in Python: sleep to absolute deadlines on
CLOCK_MONOTONIC at the same SCHED_FIFO priority, with memory locked. It measures what the machine
allows, once beside the busy cores alone and once beside the simulated firmware too, which holds
the kernel for moments as any process does that uses it.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from dataclasses import dataclass

from benchmarks import machine
from benchmarks.rig import Driven
from robotctl.deploy.rehearsal import busy
from robotctl.messages.control import LoopStatistics
from robotctl.runtime.realtime import LoopConfig

RATES_HZ = (200, 1000)
ALLOWED_US = 50.0
ALLOWED_MISSED = 0.001
PRIORITY = LoopConfig().priority
_HISTOGRAM_US = 50_000


@dataclass(frozen=True, slots=True)
class Lag:
    """Lags of one round [us]."""

    p50: float
    p99: float
    p999: float
    maximum: float


def run(rounds: int, seconds: float) -> None:
    """Measure both in turn, with one busy process of normal priority for each core."""
    cyclictest = _cyclictest()
    for rate_hz in RATES_HZ:
        ours: list[LoopStatistics] = []
        alone: list[Lag] = []
        beside: list[Lag] = []
        stops = 0
        with busy(os.cpu_count() or 1):
            for _ in range(rounds):
                with Driven(rate_hz) as robot:
                    ours.append(robot.drive(seconds).loop)
                    stops += robot.stops
                if cyclictest:
                    alone.append(measure_cyclictest(cyclictest, rate_hz, seconds))
                    with Driven(rate_hz, module=""):
                        beside.append(measure_cyclictest(cyclictest, rate_hz, seconds))
        _print(rate_hz, ours, {"alone": alone, "beside firmware_sim": beside}, stops)


def _print(
    rate_hz: int, loops: list[LoopStatistics], theirs: dict[str, list[Lag]], stops: int
) -> None:
    ours = [
        Lag(loop.lag_us_p50, loop.lag_us_p99, loop.lag_us_p999, loop.lag_us_max) for loop in loops
    ]
    rows = [_row("robotctl", ours)]
    rows += [_row(f"cyclictest {how}", lags) for how, lags in theirs.items() if lags]
    heads = ("loop", "p50 us", "p99 us", "p99.9 us (rounds)", "greatest us (rounds)")
    machine.table(f"Loop lag at {rate_hz} Hz, all cores busy, priority {PRIORITY}", heads, rows)
    p999 = machine.median(lag.p999 for lag in ours)
    for how, lags in theirs.items():
        if lags:
            difference = p999 - machine.median(lag.p999 for lag in lags)
            machine.note(
                f"p99.9 is {difference:+.0f} us from cyclictest {how}: "
                f"{difference / ALLOWED_US:.2f} of the {ALLOWED_US:g} us allowed"
            )
    ticks, missed = sum(loop.ticks for loop in loops), sum(loop.overruns for loop in loops)
    causes: dict[str, int] = {}
    for loop in loops:
        for cause, count in loop.overrun_causes.items():
            causes[cause] = causes.get(cause, 0) + count
    share = missed / max(ticks + missed, 1)
    machine.note(
        f"{missed} of {ticks + missed} deadlines missed ({100 * share:.3f} %, "
        f"{share / ALLOWED_MISSED:.2f} of what is allowed): {_words(causes)}; the robot stopped "
        f"{stops} times for want of feedback"
    )


def _row(name: str, lags: list[Lag]) -> tuple[str, ...]:
    return (
        name,
        f"{machine.median(lag.p50 for lag in lags):.0f}",
        f"{machine.median(lag.p99 for lag in lags):.0f}",
        machine.spread([lag.p999 for lag in lags]),
        machine.spread([lag.maximum for lag in lags]),
    )


def _words(causes: dict[str, int]) -> str:
    return ", ".join(f"{cause} {count}" for cause, count in sorted(causes.items())) or "none"


def _cyclictest() -> str | None:
    """Return the program, installing it where that is possible, or say what is missing."""
    found = shutil.which("cyclictest")
    if found is None and os.geteuid() == 0 and shutil.which("apt-get"):
        command = ["apt-get", "install", "-y", "--no-install-recommends", "rt-tests"]
        subprocess.run(command, check=False, capture_output=True)
        found = shutil.which("cyclictest")
    if found is None:
        machine.note("cyclictest is missing: as root, `apt-get install rt-tests`; lag stands alone")
    elif os.geteuid() != 0:
        machine.note("not root: neither robotctl nor cyclictest gets SCHED_FIFO")
    return found


def measure_cyclictest(program: str, rate_hz: int, seconds: float) -> Lag:
    """Run cyclictest with one thread for so long."""
    command = [program, "-m", "-q", "-t", "1", "-p", str(PRIORITY), "-i", str(1_000_000 // rate_hz)]
    loops = round(seconds * rate_hz)
    command += ["-l", str(loops), "-h", str(_HISTOGRAM_US)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    counts = [
        (int(us), int(count)) for us, count in re.findall(r"^(\d+)\s+(\d+)\s*$", output, re.M)
    ]
    greatest = re.search(r"# Max Latencies:\s*(\d+)", output)
    maximum = float(greatest[1]) if greatest else float("nan")
    total = loops  # beyond the histogram lies what is missing from it
    return Lag(*(_percentile(counts, total, maximum, q) for q in (0.5, 0.99, 0.999)), maximum)


def _percentile(counts: list[tuple[int, int]], total: int, maximum: float, share: float) -> float:
    reached = 0
    for us, count in counts:
        reached += count
        if reached >= share * total:
            return float(us)
    return maximum
