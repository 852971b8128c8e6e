"""The flight recorder: what each tick of a simulated mission costs, timed alone, and a dump."""

from __future__ import annotations

import functools
import tempfile
import time
from pathlib import Path

from benchmarks import machine
from robotctl.app.config import find_file
from robotctl.app.lockstep import LockstepRun
from robotctl.app.options import StackOptions
from robotctl.app.replay import replay_file
from robotctl.app.robot import record_header
from robotctl.app.sim_options import SimOptions
from robotctl.runtime.checkpoint import checkpoint
from robotctl.runtime.flight_ring import FlightRing, dump

RATES_HZ = (200, 1000)
TARGET_SHARE = 0.01
_MEMORY = Path("/dev/shm")


def run(rounds: int, seconds: float) -> None:
    """Measure `FlightRing.record` on the inputs and outputs of a patrol."""
    means_us, p99s_us, longest_us, dumps_ms = [], [], [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory(dir=_MEMORY) as folder:
            times_ns, dump_ms = _one_round(Path(folder), seconds)
        times_ns.sort()
        means_us.append(sum(times_ns) / len(times_ns) / 1e3)
        p99s_us.append(times_ns[len(times_ns) * 99 // 100] / 1e3)
        longest_us.append(times_ns[-1] / 1e3)
        dumps_ms.append(dump_ms)
    mean_us = machine.median(means_us)
    rows = [
        (
            f"{rate_hz} Hz",
            f"{mean_us:.2f}",
            f"{machine.median(p99s_us):.1f}",
            f"{machine.median(longest_us):.0f}",
            f"{mean_us * rate_hz / 1e4:.3f} %",
            f"{mean_us * rate_hz / 1e6 / TARGET_SHARE:.2f}",
        )
        for rate_hz in RATES_HZ
    ]
    heads = ("loop", "mean us", "p99 us", "max us (checkpoint)", "CPU", "of the 1 % allowed")
    machine.table("Flight recorder: one tick", heads, rows)
    machine.note(f"a dump takes {machine.median(dumps_ms):.1f} ms, in another process")


def _one_round(folder: Path, seconds: float) -> tuple[list[int], float]:
    """Return the time of each tick [ns] and of the dump [ms]; the dump must replay."""
    mission = find_file("patrol", "missions")
    lockstep = LockstepRun(SimOptions(find_file("diff_drive"), mission, max_seconds=seconds))
    bench = lockstep.bench
    header = record_header(lockstep.config, StackOptions("x", "", x_m=1.0, y_m=1.0))
    ring = FlightRing(folder / "x.ring", header, functools.partial(checkpoint, bench.core))
    times_ns: list[int] = []
    tick = bench.tick

    def timed(requests: tuple = ()):  # type: ignore[type-arg,no-untyped-def]
        outputs = tick(requests)
        begin_ns = time.perf_counter_ns()
        ring.record(bench.clock.now_ns(), bench.inputs, outputs, 1000, 200_000)
        times_ns.append(time.perf_counter_ns() - begin_ns)
        return outputs

    bench.tick = timed  # type: ignore[method-assign]
    for _ in lockstep.steps():
        pass
    begin_ns = time.perf_counter_ns()
    dump(folder / "x.ring", folder / "x.rec")
    dump_ms = (time.perf_counter_ns() - begin_ns) / 1e6
    result = replay_file(folder / "x.rec").result
    if result.difference is not None:
        raise AssertionError(f"the dump does not replay: {result.difference}")
    ring.close()
    return times_ns, dump_ms
