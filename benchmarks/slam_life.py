"""An hour of SLAM in one building: does the map stop growing, and do steps stay as quick?

The robot drives round the office, into its rooms, again and again. CPU time is that of localising
and mapping in a step of navigation, in one process under virtual time.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.app.localisation.slam_localiser import SlamLocaliser
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.core.navigation_tick import NavigationTick
from robotctl.estimation.sensor_names import LIDAR, SONAR

LONGEST_S = 3600.0
PERIOD_S = 360.0
PLACES = (
    (3.0, 4.8), (8.5, 4.8), (14.0, 4.8), (19.5, 4.8), (24.0, 4.8), (30.5, 7.5), (30.5, 2.5),
    (2.5, 10.0), (1.5, 7.5),
)  # fmt: skip
HEADER = 'name = "rounds"\nworld = "office"\nstart = { x_m = 1.5, y_m = 7.5, heading_deg = 0.0 }\n'
GOTO = '[[item]]\nkind = "goto"\nx_m = {}\ny_m = {}\n'
AGAIN = '[[item]]\nkind = "repeat"\nfirst = 1\n'


def run(_rounds: int, seconds: float) -> None:
    """Drive for an hour, or `seconds` if that is more than ten minutes, by each sensor."""
    longest_s = seconds if seconds > 600.0 else LONGEST_S
    for sensor in (LIDAR, SONAR):
        _live(sensor, longest_s)


def _live(sensor: str, longest_s: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "rounds.toml"
        mission.write_text(HEADER + "".join(GOTO.format(*each) for each in PLACES) + AGAIN)
        file = Path(folder) / "office.keyframes"
        settings = (
            'localisation.method="slam"', "localisation.mapping=true",
            f'localisation.keyframes="{file}"', f'localisation.sensors=["{sensor}"]',
        )  # fmt: skip
        options = SimOptions(
            find_file("diff_drive"), mission, max_seconds=longest_s, localisation=settings
        )
        lockstep = LockstepRun(options)
        rows = _driven(lockstep, file)
    machine.table(
        f"SLAM by {sensor} for {longest_s / 60.0:.0f} min in the office",
        ("min", "m", "keyframes", "links", "file [MB]", "VmRSS [MiB]", "step mean, p99, max [ms]",
         "pose error max [m]"),
        rows,
    )  # fmt: skip


def _driven(lockstep: LockstepRun, file: Path) -> list[tuple[str, ...]]:
    """Drive; return a row for each period."""
    timed = lockstep._tick = _Timed(lockstep._tick)  # type: ignore[assignment]
    estimators = lockstep._estimators
    assert estimators is not None
    assert isinstance(estimators.localiser, SlamLocaliser)
    mapper = estimators.localiser.mapper
    rows: list[tuple[str, ...]] = []
    error_m = 0.0
    for control, _ in lockstep.steps():
        now_s = lockstep.stack.clock.now_ns() * 1e-9
        state = lockstep._tick.localisation
        if state is not None:
            pose = state.T_world_odom @ control.T_odom_base
            truth = lockstep.stack.simulation.truth()
            error_m = max(error_m, float(np.hypot(pose.x_m - truth.x_m, pose.y_m - truth.y_m)))
        if now_s < PERIOD_S * (len(rows) + 1):
            continue
        ms = 1e3 * np.array(timed.times_s)
        timed.times_s.clear()
        rows.append(
            (
                f"{now_s / 60.0:.0f}",
                f"{lockstep.stack.simulation.truth().distance_m:.0f}",
                str(len(mapper.keyframes)),
                str(len(mapper.back_end.links)),
                f"{file.stat().st_size / 1e6:.2f}",
                f"{_resident_mib():.0f}",
                f"{ms.mean():.1f}, {np.percentile(ms, 99.0):.0f}, {ms.max():.0f}",
                f"{error_m:.3f}",
            )
        )
        error_m = 0.0
    return rows


def _resident_mib() -> float:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmRSS:")[1].split()[0]) / 1024.0


class _Timed:
    """A tick whose localising is timed."""

    def __init__(self, tick: NavigationTick) -> None:
        self._tick = tick
        self.times_s: list[float] = []

    def __getattr__(self, name: str) -> object:
        return getattr(self._tick, name)

    def localise(self, now_ns: int) -> None:
        """Take the CPU time of the step."""
        begin_s = time.thread_time()
        self._tick.localise(now_ns)
        self.times_s.append(time.thread_time() - begin_s)
