"""The simulated robot's calibration drives: squares both ways and straights, in lockstep.

Each drive begins with a fresh robot on the same mark and a seed of its own. What a tape measure
would say comes from the simulation's truth, with the errors of a tape and of placing a robot by
hand: the estimate sees what a real user would have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.errors import CalibrationError
from robotctl.estimation.odometry.model import OdometryModel
from robotctl.estimation.odometry.runs import OdometryRun
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.odometry.calibrate_sources import (
    MeasuredRun,
    MeasuredRuns,
    measured_run,
    wheels_of,
)

STRAIGHT: Final = "straight"
LEFT: Final = "left"
RIGHT: Final = "right"
STRAIGHTS: Final = 3
SQUARES: Final = 5
"""Drives of each kind; Borenstein and Feng drive five squares in each direction."""

_TOLD = MeasuredRuns((MeasuredRun("", 0.0, 0.0),))
"""The errors of tape and placing, as a file of measured runs has them by default."""

Progress: TypeAlias = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Campaign:
    """The drives, and the robot.

    Parameters
    ----------
    robot
        The robot's file.
    overrides
        `key=value` settings on top of it; those of `simulation.` disturb only the true robot, those
        of `drive.` only the controller's model.
    seed
        Seed from which each drive's own seed is derived.
    """

    robot: Path
    overrides: tuple[str, ...] = ()
    seed: int = 1

    def drives(self, model: OdometryModel, progress: Progress) -> Iterator[OdometryRun]:
        """Yield the measured drives of a whole calibration.

        Raises
        ------
        CalibrationError
            If the robot does not finish one.
        """
        shapes = STRAIGHTS * [STRAIGHT] + SQUARES * [LEFT, RIGHT]
        for i, shape in enumerate(shapes):
            progress(f"drive {i + 1} of {len(shapes)}: {shape}")
            seed = 1000 * self.seed + i
            odometry, end = self.drive(shape, seed)
            stamps_ns, rolled = wheels_of(Recording(shape, odometry=odometry), model)
            told = _by_tape(end, np.random.default_rng(seed))
            yield measured_run(f"{shape} {i + 1}", stamps_ns, rolled, told, _TOLD)

    def gaps_m(self, progress: Progress) -> dict[str, tuple[float, float]]:
        """Drive each square twice; return the errors of odometry at their ends, as `shape_gap`."""
        gaps: dict[str, tuple[float, float]] = {}
        for shape in (LEFT, RIGHT):
            ends = []
            for i in range(2):
                progress(f"square to the {shape} with the new values, {i + 1} of 2")
                odometry, end = self.drive(shape, 1000 * self.seed + 500 + i)
                first, last = (SE2(*row) for row in odometry.poses[[0, -1]].tolist())
                said = first.inverse() @ last
                ends.append((end.x_m - said.x_m, end.y_m - said.y_m))
            x_m, y_m = np.mean(ends, axis=0).tolist()
            gaps[shape] = (x_m, y_m)
        return gaps

    def drive(self, shape: str, seed: int) -> tuple[Trajectory, SE2]:
        """Return the robot's odometry and its true end, both relative to its start.

        Raises
        ------
        CalibrationError
            If it does not come to the end.
        """
        mission = find_file(f"calibrate_{shape}", "missions")
        # The odometry of the wheels alone is wanted.
        overrides = (*self.overrides, "imu.enabled=false")
        run = LockstepRun(SimOptions(self.robot, mission, seed=seed, overrides=overrides))
        truth = run.stack.simulation.truth()
        start = SE2(truth.x_m, truth.y_m, truth.theta_rad)
        stamps_ns, poses, done, why = [], [], False, ""
        for control, navigation in run.steps():
            stamps_ns.append(control.stamp_ns)
            poses.append((control.x_m, control.y_m, control.theta_rad))
            done, why = navigation.mission_completed, control.reason or navigation.message
        truth = run.stack.simulation.truth()
        if not done or truth.collisions:
            why = "it met a wall" if truth.collisions else why
            raise CalibrationError(f"the robot did not drive the {shape} to its end: {why}")
        odometry = Trajectory(np.array(stamps_ns, dtype=np.int64), np.array(poses))
        end = start.inverse() @ SE2(truth.x_m, truth.y_m, truth.theta_rad)
        return odometry, end


def _by_tape(end: SE2, rng: np.random.Generator) -> MeasuredRun:
    """Return the tape-measured end of a robot that was placed by hand."""
    sigma = np.array(_TOLD.start_sigma)
    placed = SE2(*(sigma * rng.standard_normal(3)).tolist())
    seen = placed @ end
    dx, dy = (_TOLD.tape_sigma_m * rng.standard_normal(2)).tolist()
    return MeasuredRun("", seen.x_m + dx, seen.y_m + dy)


def systematic_error_m(gaps: dict[str, tuple[float, float]]) -> float:
    """Return Borenstein's E_max,syst: the greater of both directions' mean gaps [m]."""
    return max(math.hypot(x_m, y_m) for x_m, y_m in gaps.values())
