"""robotctl at work on this computer in a simulated world: what `robotctl doctor --bench` measures.

`robotctl sim` drives the robot of the file with all its processes in real time, while another
process watches what they cost. Its record has the lag of each tick, its log the time of the steps
of navigation. The simulator, which a robot has no use for, is counted apart.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.app.supervision.child_process import start_child
from robotctl.config.robot_file import RobotConfig
from robotctl.deploy.process_costs import Cost, CostMeter
from robotctl.errors import RobotctlError
from robotctl.logs.formats.robotctl_log import json_messages
from robotctl.messages.control import StepBudget
from robotctl.runtime.flight.recorder import Tick, read_record

Numbers = NDArray[np.float64]

_POLL_S: Final = 1.0
"""Time between two looks at the processes [s]: to read their memory holds them up for a moment."""


class RehearsalError(RobotctlError):
    """The simulated run gave nothing to judge this computer by."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """Punctuality and costs of one simulated run.

    Parameters
    ----------
    rate_hz, navigation_hz
        Rates of control and of navigation [Hz].
    lag_us, tick_us
        For each tick of control, the wake-up latency after its deadline, and the time from then to
        the commands on the bus, (n,) [us].
    publish_us
        Time to tell other processes after that, 99th percentile [us].
    missed
        Deadlines of control that passed during a tick.
    step_ms
        Time of steps of navigation up to their command, (n,) [ms]; the log has about every second
        one. Empty where a busy computer let none be done.
    budget
        Navigation's own statistics of its last steps, with their parts.
    costs
        Costs of each process by its name, and of the simulator.
    """

    rate_hz: float
    navigation_hz: float
    lag_us: Numbers
    tick_us: Numbers
    publish_us: float
    missed: int
    step_ms: Numbers
    budget: StepBudget
    costs: dict[str, Cost]

    @property
    def control_hz(self) -> float:
        """Highest rate of control whose work fills half of its period [Hz].

        Work is what 99 of 100 ticks need, and the lag of 999 of 1000.
        """
        work_us = (
            np.percentile(self.tick_us, 99.0) + self.publish_us + np.percentile(self.lag_us, 99.9)
        )
        return float(0.5e6 / work_us)

    @property
    def navigating_hz(self) -> float:
        """Highest rate of navigation whose steps, 99 of 100, fill 0.8 of its period [Hz].

        0 where no step was done.
        """
        if not len(self.step_ms):
            return 0.0
        return float(800.0 / np.percentile(self.step_ms, 99.0))


def rehearse(
    robot: Path,
    overrides: tuple[str, ...],
    config: RobotConfig,
    seconds: float,
    tell: Callable[[float], None],
) -> Rehearsal:
    """Drive for a time from arming on, in simulation, and return what it took.

    Parameters
    ----------
    robot, overrides
        The robot's file and `key=value` settings on top of it.
    config
        What they say.
    seconds
        Time to drive [s].
    tell
        Called all the time with the time since the start [s].

    Raises
    ------
    RehearsalError
        If the run ended before the robot drove.
    """
    with tempfile.TemporaryDirectory(prefix="robotctl-bench-") as name:
        folder = Path(name)
        command = [
            *(sys.executable, "-m", "robotctl", "sim", "--robot", str(robot)),
            *(part for each in overrides for part in ("--set", each)),
            *("--headless", "--hard-real-time", "--stay", "--max-seconds", f"{seconds:g}"),
            *("--record", str(folder / "run"), "--report", str(folder / "report.json")),
        ]
        with (folder / "said").open("w+") as said:
            with start_child(command, stdout=said, stderr=said, text=True) as process:
                try:
                    meter = _watch(process, tell)
                finally:  # interrupted, it writes until it has ended
                    process.terminate()
                    process.wait()
            said.seek(0)
            lines = said.read().strip().splitlines()
        try:
            report = msgspec.json.decode((folder / "report.json").read_bytes(), type=dict[str, Any])
        except FileNotFoundError:
            why = lines[-1] if lines else f"status {process.returncode}"
            raise RehearsalError(f"the simulated run gave no result: {why}") from None
        return _judged(folder / "run", report, meter.costs(seconds), config)


def _judged(
    folder: Path, report: dict[str, Any], costs: dict[str, Cost], config: RobotConfig
) -> Rehearsal:
    """Return what a run's folder and report say."""
    ticks = np.array(
        [
            (entry.lag_ns / 1e3, entry.step_ns / 1e3)
            for file in sorted(folder.glob("*.rec"))
            for entry in _entries(file)
        ]
    ).reshape(-1, 2)
    steps = [
        msgspec.json.decode(message.data, type=_Step)
        for file in sorted(folder.glob("*.mcap"))
        for topic, message in json_messages(file, [])
        if topic == "navigation"
    ]
    if not len(ticks):
        raise RehearsalError(f"the simulated run ended at once: {report['ended']}")
    return Rehearsal(
        rate_hz=report["loop"]["rate_hz"],
        navigation_hz=config.navigation.rate_hz,
        lag_us=ticks[:, 0],
        tick_us=ticks[:, 1],
        publish_us=report["loop"]["stage_us"]["p99"]["publish"],
        missed=report["loop"]["overruns"],
        step_ms=np.array([each.step_us for each in steps]) / 1e3,
        budget=steps[-1].budget if steps else StepBudget(),
        costs=costs,
    )


class _Step(msgspec.Struct):
    """Part of a logged state of navigation."""

    step_us: float
    budget: StepBudget


def _entries(file: Path) -> Iterator[Tick]:
    """Yield the ticks of a record."""
    with file.open("rb") as source:
        _, entries = read_record(source, str(file))
        yield from (each for each in entries if isinstance(each, Tick))


def _watch(process: subprocess.Popen[str], tell: Callable[[float], None]) -> CostMeter:
    """Watch a run until it is over."""
    meter, begin_s = CostMeter(process.pid), time.monotonic()
    while process.poll() is None:
        now_s = time.monotonic()
        meter.look(now_s)
        tell(now_s - begin_s)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_POLL_S)
    return meter


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep so many processes of normal priority busy."""
    spin = [sys.executable, "-c", "while True: pass"]
    processes = [start_child(spin) for _ in range(count)]
    try:
        yield
    finally:
        for each in processes:
            each.kill()
            each.wait()
