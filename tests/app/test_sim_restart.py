"""A process of a simulated robot that ends under way, and what its next life knows."""

import math
import os
import signal
import time
from pathlib import Path

import pytest

from robotctl.app.config import find_file
from robotctl.app.sim import Progress, SimRun
from robotctl.app.sim_options import SimOptions
from robotctl.app.stack import NAVIGATION
from robotctl.model.localisation import LocalisationStatus
from robotctl.runtime.messages import Mode

WAY_M = 2.5
"""From the start: more than any localiser may be off."""

ERROR_M = 0.3


def pid_of(module: str) -> int:
    """Return the process id of a child of this process that runs a module."""
    (pid,) = (
        child
        for tasks in Path("/proc/self/task").iterdir()
        for child in map(int, (tasks / "children").read_text().split())
        if module.encode() in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
    )
    return pid


def error_m(progress: Progress) -> float:
    """Return the distance between where the robot believes to be and where it is [m]."""
    control, truth = progress.control, progress.truth
    if control is None or truth is None:
        return math.nan
    return math.hypot(control.x_m - truth.x_m, control.y_m - truth.y_m)


@pytest.mark.timeout(240)
def test_a_localiser_that_is_killed_under_way_knows_the_place_again_and_nothing_drives_on(
    tmp_path: Path,
) -> None:
    options = SimOptions(
        find_file("diff_drive"),
        find_file("patrol", "missions"),
        bus=f"simcan:restart-{os.getpid()}",
        max_seconds=200.0,
        overrides=("mavlink.link=[]",),
        localisation=('localisation.method="ekf"',),
    )
    killed_ns = 0
    with SimRun(options) as run:
        for progress in run.steps():
            control, truth, navigation = progress.control, progress.truth, progress.navigation
            if control is None or truth is None or navigation is None:
                continue
            start = run.mission.start
            if not killed_ns and math.hypot(truth.x_m - start.x_m, truth.y_m - start.y_m) > WAY_M:
                assert error_m(progress) < ERROR_M
                os.kill(pid_of(NAVIGATION), signal.SIGKILL)
                killed_ns = time.monotonic_ns()
                distance_m = truth.distance_m
            place = progress.localisation
            again_ns = min(navigation.stamp_ns, 0 if place is None else place.stamp_ns)
            if 0 < killed_ns < again_ns < control.stamp_ns:
                break
        assert killed_ns
        assert any("navigation ended" in line for line in progress.lines)
        assert place is not None
        assert place.status is LocalisationStatus.LOCALISED
        assert navigation.mode is Mode.HOLD
        assert error_m(progress) < ERROR_M
        assert truth.distance_m - distance_m < 0.5
