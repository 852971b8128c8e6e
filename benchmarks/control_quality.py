"""Control quality in lockstep, at a full and at a partly empty battery. Same seed, same figures."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks import machine
from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file, load_robot
from robotctl.control.identification.step_metrics import step_metrics
from robotctl.workbench.tuning.track import ExperimentSetting, speed_step

CHARGES = (1.0, 0.7)
STEP_M_S = 0.5
SQUARE_M = 8.0
SEEDS = range(1, 6)

_SQUARE = """
name = "square"
world = "empty_room"
start = { x_m = 2.0, y_m = 1.0, heading_deg = 0.0 }
[[item]]
kind = "drive"
name = "square"
waypoints = [[2.0, 1.0], [4.0, 1.0], [4.0, 3.0], [2.0, 3.0], [2.0, 1.0]]
corner_radius_m = 0.1
speed_m_s = 0.4
"""


def run(_rounds: int, _seconds: float) -> None:
    """Step each robot's speed, and drive a square by odometry alone."""
    rows = [
        _step_row(robot, charge)
        for robot in ("diff_drive", "tricycle", "ackermann")
        for charge in CHARGES
    ]
    heads = ("robot, battery", "V", "rise s", "settling s", "overshoot %", "steady error %")
    title = f"Speed step 0 to {STEP_M_S} m/s, true speed (allowed: 0.4 s, 5 %, 1 %)"
    machine.table(title, heads, rows)
    title = f"Square of 4 x 2 m by odometry, true end against start, seeds {[*SEEDS]}"
    heads = ("battery", "off m: median (least to greatest)", "share of length %", "allowed %")
    machine.table(title, heads, [_square_row(charge) for charge in CHARGES])


def _step_row(robot: str, charge: float) -> tuple[str, ...]:
    path = find_file(robot)
    stack = ExperimentSetting(path, charge=charge).stack(load_robot(path))
    step = speed_step(stack, STEP_M_S, 2.0)
    found = step_metrics(step.time_s, step.true_m_s, STEP_M_S)
    return (
        f"{robot}, {100 * charge:.0f} %",
        f"{stack.snapshot().bus_voltage_v:.2f}",
        _seconds(found.rise_s),
        _seconds(found.settling_s),
        f"{100 * found.overshoot:.2f}",
        f"{100 * abs(found.steady_state_error):.2f}",
    )


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.3f}"


def _square_row(charge: float) -> tuple[str, ...]:
    off_m = []
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "square.toml"
        mission.write_text(_SQUARE, encoding="utf-8")
        for seed in SEEDS:
            run = LockstepRun(
                SimOptions(
                    robot=find_file("diff_drive"),
                    mission=mission,
                    seed=seed,
                    overrides=(f"simulation.battery.charge={charge}",),
                )
            )
            begin = run.stack.simulation.truth()
            report = run.run()
            end = run.stack.simulation.truth()
            # Where odometry says that the robot stands, seen from where it ought to stand.
            missed = np.array([run.stack.snapshot().x_m - 2.0, run.stack.snapshot().y_m - 1.0])
            moved = np.array([end.x_m - begin.x_m, end.y_m - begin.y_m])
            off_m.append(float(np.hypot(*(moved - missed))))
            if not report.mission_completed:
                machine.note(f"seed {seed}: {report.message}")
    share = 100 * machine.median(off_m) / SQUARE_M
    return f"{100 * charge:.0f} %", machine.spread(off_m, 3), f"{share:.2f}", "2"
