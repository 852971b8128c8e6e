"""Tick cost: receive, decode, step, limit, encode, send in the real control process over simcan."""

from __future__ import annotations

import os
from contextlib import nullcontext

from benchmarks import machine
from benchmarks.rig import Driven
from robotctl.app.supervision.stack import CONTROL
from robotctl.deploy.rehearsal import busy
from robotctl.messages.control import LoopStatistics

TARGET_US = 150.0
RATES_HZ = (200, 1000)
STAGES = ("receive", "control", "send", "publish")
OURS = "robotctl"
AWAKE = "robotctl, wake_latency_us = 0"
BUSY = "robotctl, all cores busy"
PEER = "python-can + cantools"
VARIANTS: dict[str, tuple[str, tuple[str, ...]]] = {
    OURS: (CONTROL, ()),
    AWAKE: (CONTROL, ("runtime.wake_latency_us=0",)),
    BUSY: (CONTROL, ()),
    PEER: ("benchmarks.ordinary", ()),
}
_LONGEST_S = 6.0


def run(rounds: int, seconds: float) -> None:
    """Measure robotctl and its peer in turn.

    A virtual processor that sleeps between ticks wakes with cold caches. So robotctl is measured as
    it is, with processors that do not sleep, and with processors that have other work.
    """
    rows = []
    for rate_hz in RATES_HZ:
        measured: dict[str, list[LoopStatistics]] = {name: [] for name in VARIANTS}
        for _ in range(rounds):
            for name, (module, overrides) in VARIANTS.items():
                load = busy(os.cpu_count() or 1) if name == BUSY else nullcontext()
                with load, Driven(rate_hz, module, overrides) as robot:
                    measured[name].append(robot.drive(min(seconds, _LONGEST_S)).loop)
        medians = {
            name: machine.median(loop.step_us_p50 for loop in loops)
            for name, loops in measured.items()
        }
        ours = medians[OURS]
        rows += [
            _row(f"{rate_hz} Hz, {name}", loops, medians[name] / ours)
            for name, loops in measured.items()
        ]
        machine.note(
            f"{rate_hz} Hz: the peer takes {medians[PEER] / ours:.2f} times as long; robotctl uses "
            f"{ours * rate_hz / 1e4:.1f} % of a core, {ours / TARGET_US:.2f} of the {TARGET_US:g} "
            "us allowed"
        )
    heads = ("loop", "tick p50 us (rounds)", "p99 us", "ratio", *(f"{s} us" for s in STAGES))
    machine.table("Tick cost over simcan: two wheels, eight sonars", heads, rows)


def _row(name: str, loops: list[LoopStatistics], ratio: float) -> tuple[str, ...]:
    return (
        name,
        machine.spread([loop.step_us_p50 for loop in loops]),
        f"{machine.median(loop.step_us_p99 for loop in loops):.0f}",
        f"{ratio:.2f}",
        *(f"{machine.median(loop.stage_us_p50[s] for loop in loops):.1f}" for s in STAGES),
    )
