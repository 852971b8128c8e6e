"""`robotctl doctor --bench`: what robotctl takes of this computer, at rest and under load."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.app.supervision.running_robot import names_of_running
from robotctl.deploy.check_result import Finding, fail, ok, warn
from robotctl.deploy.doctor import read_robot
from robotctl.deploy.process_costs import SIMULATOR
from robotctl.deploy.rehearsal import Numbers, Rehearsal, RehearsalError, busy, rehearse
from robotctl.words import counted

_MOST_MISSED: Final = 0.001
"""Share of deadlines that control may miss."""
_LATE_SHARE: Final = 0.1
"""Share of the period from which on the 99th percentile of lag is high."""
_LEAST_HZ: Final = 100
"""Minimum of runtime.rate_hz [Hz]."""
_BINS_US: Final = (20, 50, 100, 200, 500, 1000, 2000, 5000)
_LESS_LOAD: Final = "stop other programs, or use a faster computer"
_FULL: Final = 0.8
"""Share of all cores in use from which on little is left for what comes."""


def bench(
    robot: Path,
    overrides: tuple[str, ...],
    seconds: float,
    tell: Callable[[str, float], None],
) -> Iterator[Finding]:
    """Yield the findings as they are made: half of the time at rest, half under load.

    Parameters
    ----------
    robot, overrides
        The robot's file and `key=value` settings on top of it.
    seconds
        Time to drive, in all [s].
    tell
        Called all the time with what is done, and for how long already [s].
    """
    config = read_robot(robot, overrides)
    if isinstance(config, Finding):
        yield config
        return
    if names := names_of_running():
        yield fail(
            "bench",
            f"a robot or a simulation runs on this computer: {', '.join(names)}",
            "end it first: the two would share the processor",
        )
        return
    cores = os.cpu_count() or 1
    for phase, load in (("at rest", nullcontext()), (f"beside {cores} busy", busy(cores))):
        try:
            with load:
                found = rehearse(robot, overrides, config, 0.5 * seconds, partial(tell, phase))
        except RehearsalError as error:
            yield fail(f"bench, {phase}", str(error), "see whether `robotctl sim` drives it")
            return
        yield check_control(phase, found)
        yield check_lag(phase, found)
        yield check_navigation(phase, found)
        yield check_costs(phase, found, cores)
        yield capacity(phase, found)


def check_control(phase: str, found: Rehearsal) -> Finding:
    """Check that control met its deadlines."""
    check, ticks = f"control, {phase}", len(found.tick_us)
    p50, p99 = np.percentile(found.tick_us, (50.0, 99.0))
    missed = counted(found.missed, "deadline")
    words = (
        f"{ticks} ticks at {found.rate_hz:g} Hz, {missed} missed; a tick takes "
        f"{p50:.0f} us, p99 {p99:.0f}, of {1e6 / found.rate_hz:.0f}"
    )
    fix = "stop other programs; run as root or as the service, which has priority; see runtime.cpu"
    if found.missed > _MOST_MISSED * ticks:
        return fail(check, f"{words}: more than 1 in 1000 missed", fix)
    return warn(check, words, fix) if found.missed else ok(check, words)


def check_lag(phase: str, found: Rehearsal) -> Finding:
    """Check the wake-ups of control."""
    check = f"lag, {phase}"
    p50, p99, p999 = np.percentile(found.lag_us, (50.0, 99.0, 99.9))
    words = (
        f"p50 {p50:.0f}, p99 {p99:.0f}, p99.9 {p999:.0f}, max {found.lag_us.max():.0f} us; "
        f"{_shares(found.lag_us)}"
    )
    if p99 > _LATE_SHARE * 1e6 / found.rate_hz:
        fix = "see kernel, governor and isolation in `robotctl doctor`"
        return warn(check, f"{words}: p99 over a tenth of the period", fix)
    return ok(check, words)


def _shares(lag_us: Numbers) -> str:
    """Return the histogram of lags: which share of them is within each bound."""
    counts = [(each, int(np.sum(lag_us <= each))) for each in _BINS_US]
    some = [(each, count) for each, count in counts if count]
    first_with_all = next((i for i, (_, n) in enumerate(some, 1) if n == len(lag_us)), len(some))
    shares = (f"{each} us {n / len(lag_us):.2%}" for each, n in some[:first_with_all])
    return "within " + (", ".join(shares) or f"{_BINS_US[-1]} us none")


def check_navigation(phase: str, found: Rehearsal) -> Finding:
    """Check that navigation keeps its rate."""
    check, period_ms = f"navigation, {phase}", 1e3 / found.navigation_hz
    if not len(found.step_ms):
        return fail(check, "no step was done while the robot was armed", _LESS_LOAD)
    p50, p99 = np.percentile(found.step_ms, (50.0, 99.0))
    words = (
        f"a step takes {p50:.1f} ms, p99 {p99:.1f}, max {found.step_ms.max():.1f}, of "
        f"{period_ms:.0f}"
    )
    budget = found.budget
    parts = sorted(budget.parts_p50_ms, key=lambda part: -budget.parts_p50_ms[part])
    words += "; " + ", ".join(
        f"{part} {budget.parts_p50_ms[part]:.1f} ({budget.parts_p99_ms[part]:.1f})"
        for part in parts
    )
    if p99 > period_ms:
        fix = f"navigation.rate_hz = {max(1.0, found.navigating_hz):.0f}, or fewer programs beside"
        return warn(check, f"{words}: it does not keep {found.navigation_hz:g} Hz", fix)
    return ok(check, words)


def check_costs(phase: str, found: Rehearsal, cores: int) -> Finding:
    """Check that processor time is left."""
    ours = {name: each for name, each in found.costs.items() if name != SIMULATOR}
    used, mib = sum(each.cores for each in ours.values()), sum(each.mib for each in ours.values())
    parts = [
        f"{name} {each.cores:.0%}, {each.mib:.0f} MiB"
        for name, each in sorted(ours.items(), key=lambda item: -item[1].cores)
    ]
    words = f"{used:.2f} of {cores} cores, {mib:.0f} MiB: {'; '.join(parts)}"
    if SIMULATOR in found.costs:
        words += f"; the simulation beside it {found.costs[SIMULATOR].cores:.0%}"
    if used > _FULL * cores:
        return warn(f"processes, {phase}", words, "a lower rate, fewer beams, or a faster computer")
    return ok(f"processes, {phase}", words)


def capacity(phase: str, found: Rehearsal) -> Finding:
    """Return which rates this computer can carry."""
    words = (
        f"control up to {min(1000.0, found.control_hz):.0f} Hz, navigation up to "
        f"{found.navigating_hz:.0f} Hz"
    )
    if found.control_hz < found.rate_hz:
        fix = f"runtime.rate_hz = {found.control_hz:.0f} at most"
        if found.control_hz < _LEAST_HZ:
            fix = f"{_LESS_LOAD}: the lowest is {_LEAST_HZ} Hz"
        return warn(f"carries, {phase}", words, fix)
    return ok(f"carries, {phase}", words)
