"""Lockstep: the whole patrol in one process, as many times as fast as real time."""

from __future__ import annotations

import time

from benchmarks import machine
from robotctl.app.scoring.score import Report
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file

TARGET = 50.0


def run(rounds: int, _seconds: float) -> None:
    """Drive the patrol with each robot; the first run of all warms the machine up."""
    rows = []
    for robot in ("diff_drive", "tricycle", "ackermann"):
        options = SimOptions(robot=find_file(robot), mission=find_file("patrol", "missions"))
        _drive(options)
        rows.append(_row(robot, [_drive(options) for _ in range(rounds)]))
    heads = (
        "robot",
        "x real time of one core (rounds)",
        f"ratio to {TARGET:g}",
        "by the clock",
        "patrol s",
        "host's step p50 us",
    )
    machine.table("Lockstep: patrol at 200 Hz, plant at 1 kHz, eight sonars", heads, rows)


def _drive(options: SimOptions) -> tuple[float, Report]:
    """Return how many times as fast as real time one core was, waiting left out."""
    run = LockstepRun(options)
    begin_s = time.process_time()
    report = run.run()
    return report.duration_s / (time.process_time() - begin_s), report


def _row(robot: str, runs: list[tuple[float, Report]]) -> tuple[str, ...]:
    factors = [factor for factor, _ in runs]
    reports = [report for _, report in runs]
    last = reports[-1]
    return (
        robot if last.mission_completed else f"{robot} (not completed)",
        machine.spread(factors, 1),
        f"{machine.median(factors) / TARGET:.2f}",
        f"{machine.median(report.real_time_factor for report in reports):.1f}",
        f"{last.duration_s:.1f}",
        f"{machine.median(report.loop['step_us']['p50'] for report in reports):.1f}",
    )
