"""Tick cost: receive, decode, step, limit, encode, send in the real control process over simcan."""

from __future__ import annotations

from benchmarks import machine
from benchmarks.rig import Driven
from robotctl.app.stack import CONTROL
from robotctl.runtime.messages import LoopStatistics

TARGET_US = 150.0
RATES_HZ = (200, 1000)
PEER = "benchmarks.ordinary"
STAGES = ("receive", "control", "send", "publish")


def run(rounds: int, seconds: float) -> None:
    """Measure robotctl and its peer in turn."""
    rows = []
    for rate_hz in RATES_HZ:
        measured: dict[str, list[LoopStatistics]] = {CONTROL: [], PEER: []}
        for _ in range(rounds):
            for module, results in measured.items():
                with Driven(rate_hz, module) as robot:
                    results.append(robot.drive(seconds).loop)
        ours, peer = (
            machine.median(loop.step_us_p50 for loop in loops) for loops in measured.values()
        )
        rows.append(_row(f"{rate_hz} Hz, robotctl", measured[CONTROL], ours, ours))
        rows.append(_row(f"{rate_hz} Hz, python-can + cantools", measured[PEER], peer, ours))
        machine.note(
            f"{rate_hz} Hz: the peer takes {peer / ours:.2f} times as long; robotctl uses "
            f"{ours * rate_hz / 1e4:.1f} % of a core, {ours / TARGET_US:.2f} of the {TARGET_US:g} "
            "us allowed"
        )
    heads = ("loop", "tick p50 us (rounds)", "p99 us", "ratio", *(f"{s} us" for s in STAGES))
    machine.table("Tick cost over simcan: two wheels, eight sonars", heads, rows)


def _row(
    name: str, loops: list[LoopStatistics], median_us: float, ours_us: float
) -> tuple[str, ...]:
    return (
        name,
        machine.spread([loop.step_us_p50 for loop in loops]),
        f"{machine.median(loop.step_us_p99 for loop in loops):.0f}",
        f"{median_us / ours_us:.2f}",
        *(f"{machine.median(loop.stage_us_p50[s] for loop in loops):.1f}" for s in STAGES),
    )
