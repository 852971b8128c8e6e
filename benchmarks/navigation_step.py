"""The navigation step while driving by plan with lidar, MCL and MPPI among people and clutter.

In lockstep each step's processor time is measured, alone; live it is what the navigation process
reports of its steps, with all other processes beside it on this machine.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.room import goal_mission
from robotctl.app.simulation.sim import SimRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.core.navigation_tick import NavigationTick
from robotctl.maps.world import find_world

START, GOAL = (1.5, 7.5, 0.0), (20.5, 11.5)
"""Along the office's corridor, into a room."""
ROBOTS = ("diff_drive", "ackermann")
LIDAR = "simulation.lidar.beams=360"


def run(_rounds: int, seconds: float) -> None:
    """Measure both, each for six times the seconds of a round at most."""
    rows = []
    for robot in ROBOTS:
        with tempfile.TemporaryDirectory() as folder:
            options = _options(robot, Path(folder), 6.0 * seconds)
            rows.append((robot, "lockstep, processor", *_figures(_lockstep(options))))
            rows.append((robot, "live, wall clock", *_figures(_live(options))))
    heads = ("robot", "run", "steps", "median, ms", "99 %, ms", "99.9 %, ms", "greatest, ms")
    machine.table("Navigation step: 360 beams, MCL, MPPI, 2 people, 8 boxes", heads, rows)


def _options(robot: str, folder: Path, seconds: float) -> SimOptions:
    mission = folder / "goal.toml"
    mission.write_text(goal_mission(find_world("office"), START, GOAL), encoding="utf-8")
    return SimOptions(
        robot=find_file(robot),
        mission=mission,
        start=START,
        people=2,
        clutter=8,
        max_seconds=seconds,
        overrides=(LIDAR,),
        localisation=('localisation.method="mcl"',),
    )


def _figures(times_ms: list[float]) -> tuple[str, ...]:
    """Return number, median, high percentiles and the greatest."""
    at = np.percentile(times_ms, [50.0, 99.0, 99.9, 100.0])
    return (str(len(times_ms)), *(f"{each:.1f}" for each in at))


def _lockstep(options: SimOptions) -> list[float]:
    """Return the processor time of each step that drives [ms]."""
    run, times_ms = LockstepRun(options), []
    tick = run._tick = _Timed(run._tick)  # type: ignore[assignment]
    for control, _ in run.steps():
        if control.v_m_s > 0.05:
            times_ms.append(tick.step_ms)
    return times_ms


class _Timed:
    """A navigation tick that measures itself."""

    def __init__(self, tick: NavigationTick) -> None:
        self._tick = tick
        self.step_ms = 0.0

    def __getattr__(self, name: str) -> object:
        return getattr(self._tick, name)

    def localise(self, now_ns: int) -> None:
        began = time.thread_time()
        self._tick.localise(now_ns)
        self.step_ms = 1e3 * (time.thread_time() - began)

    def navigate(self, now_ns: int) -> object:
        began = time.thread_time()
        decided = self._tick.navigate(now_ns)
        self.step_ms += 1e3 * (time.thread_time() - began)
        return decided


def _live(options: SimOptions) -> list[float]:
    """Return what the navigation process says of its steps, as they are polled [ms]."""
    times_ms: list[float] = []
    stamp_ns = 0
    with SimRun(options) as run:
        for status in run.steps():
            state, control = status.navigation, status.control
            if state is None or control is None or state.stamp_ns == stamp_ns:
                continue
            stamp_ns = state.stamp_ns
            if control.v_m_s > 0.05:
                times_ms.append(state.step_us / 1e3)
    return times_ms
