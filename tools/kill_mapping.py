"""Kill navigation while it maps, over and over, and say what of the map and of the drive is lost.

`tools/kill_mapping.py [COUNT] [--sensor sonar]` drives round the flat with SLAM, all processes on
simcan, and kills navigation (SIGKILL) every few metres. The supervisor starts it again, and it goes
on with the map that it saved. Status 1 if the map had fewer scans than before, the saved place of
the robot was older than 2 s, or the robot was localised farther off than before.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

from robotctl.app.processes.navigator import load_mission
from robotctl.app.simulation.run_status import RunStatus
from robotctl.app.simulation.sim import SimRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.app.supervision.signals import StopFlag
from robotctl.app.supervision.stack import NAVIGATION
from robotctl.config.robot_file import find_file
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.messages.control import Mode
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2

MISSION = """name = "rounds"
world = "flat"
start = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0.0 }}
{}[[item]]
kind = "repeat"
first = 1
"""
PLACES = ((4.0, 1.0), (4.0, 4.0), (6.5, 2.5), (6.5, 4.0), (1.5, 2.5), (1.0, 1.0))
OLDEST_S = 2.0
FARTHEST_M = 0.1
"""The saved place is one where the robot was believed to be, and it is found as near as then."""
_ASK_S = 1.0


class Drive:
    """A run, and where the robot was believed to be when."""

    def __init__(self, run: SimRun) -> None:
        self._run = run
        self._steps = run.steps()
        self.way: list[tuple[float, float, float]] = []
        self._asked_s = 0.0

    def step(self) -> RunStatus:
        """Wait for the next state; ask for what a robot needs to drive on."""
        status = next(self._steps)
        if status.truth is not None and status.pose is not None:
            self.way.append((status.truth.stamp_ns * 1e-9, status.pose.x_m, status.pose.y_m))
        navigation = status.navigation
        is_held = navigation is not None and navigation.mode is Mode.HOLD
        if is_held and status.elapsed_s - self._asked_s > _ASK_S:
            self._asked_s = status.elapsed_s
            self._run.arm(arm=True)
            self._run.set_mode(Mode.AUTO)
        return status

    def drive(self, distance_m: float) -> None:
        """Drive on for a distance [m]."""
        status = self.step()
        begin_m = None
        while begin_m is None or status.truth.distance_m < begin_m + distance_m:
            status = self.step()
            if status.truth is not None and begin_m is None:
                begin_m = status.truth.distance_m

    def kill(self, file: Path) -> tuple[float, int, float]:
        """Kill navigation.

        Return how old the saved place is [s], how many scans are saved, and the error then [m].
        """
        error_m = error(self.step())
        os.kill(self._run._stack.pid(NAVIGATION), signal.SIGKILL)
        saved = load_keyframes(file)
        number, pose = saved.place
        place = saved.frame @ SE2(*saved.poses[number].tolist()) @ pose
        now_s = self.way[-1][0]
        off_m, at_s = min(
            (math.hypot(x_m - place.x_m, y_m - place.y_m), -at_s)
            for at_s, x_m, y_m in self.way
            if now_s - at_s < 10.0
        )
        age_s = now_s + at_s if off_m < FARTHEST_M else math.inf
        return age_s, len(saved.keyframes), error_m

    def found(self) -> tuple[float, float]:
        """Wait until the robot is localised again; return how long [s], and its error [m]."""
        begin_s, status = time.monotonic(), self.step()
        before_ns = 0 if status.localisation is None else status.localisation.stamp_ns
        while True:
            status = self.step()
            place = status.localisation
            if place is None or place.stamp_ns <= before_ns:
                continue
            if place.status is LocalisationStatus.LOCALISED and status.pose is not None:
                break
        for _ in range(20):
            status = self.step()
        return time.monotonic() - begin_s, error(status)


def error(status: RunStatus) -> float:
    """Return how far off the robot is believed to be [m]."""
    return math.hypot(status.pose.x_m - status.truth.x_m, status.pose.y_m - status.truth.y_m)


def main() -> int:
    """Kill navigation and print what was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sensor", choices=("lidar", "sonar"), default="lidar")
    options = parser.parse_args()
    rng, is_good = random.Random(options.seed), True
    with tempfile.TemporaryDirectory() as folder:
        mission, file = Path(folder) / "rounds.toml", Path(folder) / "flat.keyframes"
        items = (f'[[item]]\nkind = "goto"\nx_m = {x}\ny_m = {y}\n' for x, y in PLACES)
        mission.write_text(MISSION.format("".join(items)), encoding="utf-8")
        load_mission(mission)
        settings = (
            'localisation.method="slam"',
            "localisation.mapping=true",
            f'localisation.keyframes="{file}"',
            f'localisation.sensors=["{options.sensor}"]',
        )
        robot = find_file("diff_drive")
        run_options = SimOptions(robot, mission, max_seconds=1e9, localisation=settings)
        with SimRun(run_options, StopFlag()) as run:
            drive, kept = Drive(run), 0
            for number in range(options.count):
                drive.drive(rng.uniform(1.0, 4.0))
                age_s, scans, before_m = drive.kill(file)
                took_s, error_m = drive.found()
                is_good &= age_s <= OLDEST_S and scans >= kept
                is_good &= error_m < before_m + FARTHEST_M
                kept = scans
                print(
                    f"{number + 1}: place {age_s:.2f} s old, {scans} scans; localised after "
                    f"{took_s:.1f} s, {error_m:.3f} m off, before {before_m:.3f} m",
                    flush=True,
                )
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
