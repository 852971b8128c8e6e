"""Local controllers: time of a step in clutter, and a robot as large and fast as BARN's Jackal.

The peer is the dynamic window as PythonRobotics writes it: one arc after the other, each pose
against all points of obstacles (algorithm of its `dynamic_window_approach.py`, for the time alone).
ROBOTCTL_DATA names the folder of BARN's worlds. The worlds are known here, and the robot has delay
and noise: this measures controllers, not the whole robot.
"""

from __future__ import annotations

import gzip
import json
import math
import os
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks import machine
from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.drives.motion import integrate
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.planning.path.local.controller import ControllerConfig, LocalSituation
from robotctl.planning.path.local.controllers import CONTROLLERS

SIDE_M = 0.05
DRIVE = DifferentialDrive("differential", 0.37, 0.098, 2400)
LIMITS = LimitsConfig(2.0, 4.0, 4.0, 12.0, 40.0, 150.0)
BODY = Footprint(((0.254, -0.215), (0.254, 0.215), (-0.254, 0.215), (-0.254, -0.215)))
SAMPLES = {"dwa": 500, "mppi": 1000}
STEPS = {"dwa": 30, "mppi": 50}
NOBODY = np.empty((0, 5))
ORIGIN = SE2(-6.0, -1.0, 0.0)


class Drive(NamedTuple):
    """How a drive ended."""

    arrived: bool
    touched: bool
    time_s: float
    gap_m: float


def run(rounds: int, _seconds: float) -> None:
    """Measure all."""
    _steps(4 * rounds)
    folder = Path(os.environ.get("ROBOTCTL_DATA", machine.ROOT.parent / "shared" / "data"))
    if (folder / "barn").is_dir():
        _barn(folder / "barn" / "worlds.json.gz")
    else:
        machine.note(f"BARN: not measured, no {folder / 'barn'}; set ROBOTCTL_DATA")


def clutter(seed: int) -> PlanningMap:
    """Return 200 x 200 cells with 60 posts of 15 cm, free about the middle."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((200, 200), np.int8)
    for row, column in rng.integers(0, 197, (60, 2)):
        cells[row : row + 3, column : column + 3] = 100
    cells[88:112, 88:112] = 0
    return PlanningMap(GridMap(cells, SIDE_M), BODY)


def _config(name: str) -> ControllerConfig:
    return ControllerConfig(deceleration_m_s2=3.0, samples=SAMPLES[name])


def _steps(rounds: int) -> None:
    rows, own = [], math.nan
    for name in CONTROLLERS:
        times = []
        for seed in range(8):
            space = clutter(seed)
            controller = CONTROLLERS[name](_config(name), DRIVE, LIMITS, BODY)
            path = np.array([[5.0, 5.0, 0.0], [9.0, 6.0, 0.0]])
            situation = LocalSituation(
                SE2(5.0, 5.0, 0.2), Twist(1.0, 0.2), path, np.zeros(1, np.bool_), space, NOBODY, 2.0
            )
            controller.step(situation)
            for _ in range(rounds):
                began = time.perf_counter()
                controller.step(situation)
                times.append(1e3 * (time.perf_counter() - began))
        own = machine.median(times) if name == "dwa" else own
        size = f"{SAMPLES[name]} x {STEPS[name]}"
        rows.append((name, size, machine.spread(times, 2), f"{machine.median(times) / own:.1f}"))
    times = []
    for seed in range(3):
        points = SIDE_M * (np.argwhere(clutter(seed).blocked)[:, ::-1] + 0.5)
        began = time.perf_counter()
        _one_by_one(points)
        times.append(1e3 * (time.perf_counter() - began))
    ratio = f"{machine.median(times) / own:.0f}"
    rows.append(("one by one, NumPy", "500 x 30", machine.spread(times, 1), ratio))
    heads = ("controller", "candidates x steps", "ms", "times dwa")
    machine.table("A step among 60 posts in 200 x 200 cells", heads, rows)


def _one_by_one(points: np.ndarray) -> float:
    """Return the least cost of 500 arcs of 30 poses, as the peer finds it."""
    best = math.inf
    for v in np.linspace(0.0, 2.0, 20):
        for omega in np.linspace(-4.0, 4.0, 25):
            x, y, theta, poses = 5.0, 5.0, 0.2, []
            for _ in range(30):
                theta += omega * 0.05
                x += v * math.cos(theta) * 0.05
                y += v * math.sin(theta) * 0.05
                poses.append((x, y, theta))
            arc = np.array(poses)
            dx, dy = (points[:, i] - arc[:, i][:, np.newaxis] for i in range(2))
            c, s = np.cos(arc[:, 2])[:, np.newaxis], np.sin(arc[:, 2])[:, np.newaxis]
            inside = (np.abs(c * dx + s * dy) <= 0.254) & (np.abs(c * dy - s * dx) <= 0.215)
            near = math.inf if inside.any() else 1.0 / float(np.hypot(dx, dy).min())
            turn = math.atan2(6.0 - y, 9.0 - x) - theta
            best = min(best, 0.15 * abs(math.remainder(turn, math.tau)) + 2.0 - v + near)
    return best


def _barn(path: Path) -> None:
    data = json.loads(gzip.decompress(path.read_bytes()))
    start, goal = SE2(*data["start"]), SE2(*data["goal_m"], 0.5 * math.pi)
    rows = []
    for name in CONTROLLERS:
        drives, scores = [], []
        for world in data["worlds"]:
            space = _space(np.array(world["cylinders_m"]), data["radius_m"])
            plan = PLANNERS["astar"](PlannerConfig()).plan(space, start, goal)
            if not isinstance(plan, Plan):
                continue
            drive = _drive(name, space, plan, start, data["goal_tolerance_m"])
            best_s = 0.5 * world["path_m"]
            success = drive.arrived and not drive.touched
            scores.append(success * best_s / min(max(drive.time_s, 2.0 * best_s), 8.0 * best_s))
            drives.append(drive)
        rows.append(
            (
                name,
                f"{sum(each.arrived for each in drives)} of {len(data['worlds'])}",
                str(sum(each.touched for each in drives)),
                machine.spread([each.time_s for each in drives], 1),
                f"{machine.median(each.gap_m for each in drives):.2f}",
                f"{sum(scores) / len(data['worlds']):.3f}",
            )
        )
    heads = ("controller", "arrived", "touched", "s", "smallest gap, m", "BARN metric")
    machine.table("BARN's worlds, known to A*", heads, rows)


def _space(cylinders: np.ndarray, radius_m: float) -> PlanningMap:
    """Return a map in which each cell that a cylinder touches is blocked."""
    cells = np.zeros((320, 180), np.int8)
    rows, columns = np.mgrid[:320, :180]
    x = ORIGIN.x_m + (columns + 0.5) * SIDE_M
    y = ORIGIN.y_m + (rows + 0.5) * SIDE_M
    for at_x, at_y in cylinders:
        dx = np.maximum(np.abs(x - at_x) - 0.5 * SIDE_M, 0.0)
        dy = np.maximum(np.abs(y - at_y) - 0.5 * SIDE_M, 0.0)
        cells[np.hypot(dx, dy) < radius_m] = 100
    return PlanningMap(GridMap(cells, SIDE_M, ORIGIN), BODY)


def _drive(name: str, space: PlanningMap, plan: Plan, start: SE2, within_m: float) -> Drive:
    """Drive with a delay of one step, limited jerk, and 1 cm and 0.5 degrees of noise."""
    rng = np.random.default_rng(0)
    controller = CONTROLLERS[name](ControllerConfig(deceleration_m_s2=3.0), DRIVE, LIMITS, BODY)
    limiter, pose, twist, late = TwistLimiter(LIMITS), start, Twist(0.0, 0.0), Twist(0.0, 0.0)
    reverse = np.zeros(len(plan.poses) - 1, np.bool_)
    goal, gap_m, touched = plan.poses[-1], math.inf, False
    for i in range(600):
        x_m, y_m, angle = rng.normal(0.0, (0.01, 0.01, math.radians(0.5)))
        seen = SE2(pose.x_m + x_m, pose.y_m + y_m, pose.theta_rad + angle)
        motion = controller.step(
            LocalSituation(seen, twist, plan.poses, reverse, space, NOBODY, 2.0)
        )
        for _ in range(5):
            twist = limiter.step(late, 0.01)
            pose = integrate(pose, twist, 0.01)
            here = space.to_cells(pose)
            there = np.array([[here.x_m, here.y_m, here.theta_rad]])
            touched = touched or bool(space.collides(there)[0])
            gap_m = min(gap_m, float(space.gaps_m(there)[0]))
        late = Twist(motion.v_m_s, motion.omega_rad_s)
        if math.dist((pose.x_m, pose.y_m), goal[:2]) < within_m:
            return Drive(True, touched, 0.05 * (i + 1), gap_m)
    return Drive(False, touched, 30.0, gap_m)
