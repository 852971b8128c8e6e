"""Local controllers in closed loop: a robot with delay, jerk and noise among boxes."""

import math

import numpy as np
import pytest

from robotctl.control.limiter import LimitsConfig, TwistLimiter
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.drives.motion import integrate
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.planning.costmap.planning_map import PlanningMap
from robotctl.planning.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.global_planning.planners import PLANNERS
from robotctl.planning.local.controller import ControllerConfig, LocalSituation
from robotctl.planning.local.controllers import CONTROLLERS

SIDE_M = 0.05
BODY = Footprint(((0.2, -0.15), (0.2, 0.15), (-0.2, 0.15), (-0.2, -0.15)))
LIMITS = LimitsConfig(0.8, 2.5, 2.5, 8.0, 30.0, 100.0)
DRIVE = DifferentialDrive("differential", 0.3, 0.05, 2400)


def cluttered(seed):
    """Return a room of 6 m with boxes, free in two corners, and a pose in each of them."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((120, 120), np.int8)
    for _ in range(9):
        (height, width), (row, column) = rng.integers(4, 24, 2), rng.integers(0, 110, 2)
        cells[row : row + height, column : column + width] = 100
    cells[:24, :24] = cells[-24:, -24:] = 0
    ends = [SE2(at_m, at_m, rng.uniform(-math.pi, math.pi)) for at_m in (0.6, 5.4)]
    return PlanningMap(GridMap(cells, SIDE_M), BODY), *ends


def drive(name, space, path, reverse, start, seconds, seed=0, moving=lambda _: np.empty((0, 5))):
    """Yield time, pose, twist and motion of each step of a robot that follows a path."""
    rng = np.random.default_rng(seed)
    controller = CONTROLLERS[name](ControllerConfig(deceleration_m_s2=1.5), DRIVE, LIMITS, BODY)
    limiter, pose, twist, late = TwistLimiter(LIMITS), start, Twist(0.0, 0.0), (0.0, 0.0)
    for i in range(round(seconds / 0.05)):
        x_m, y_m, angle = rng.normal(0.0, (0.01, 0.01, 0.01))
        seen = SE2(pose.x_m + x_m, pose.y_m + y_m, pose.theta_rad + angle)
        situation = LocalSituation(seen, twist, path, reverse, space, moving(0.05 * i), 0.8)
        motion = controller.step(situation)
        for _ in range(5):
            twist = limiter.step(*late, 0.01)
            pose = integrate(pose, *twist, 0.01)
        late = motion.v_m_s, motion.omega_rad_s
        yield 0.05 * i, pose, twist, motion


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("seed", range(4))
def test_it_arrives_in_clutter_without_touching_anything(name, seed):
    space, start, goal = cluttered(seed)
    plan = PLANNERS["astar"](PlannerConfig()).plan(space, start, goal)
    assert isinstance(plan, Plan)
    reverse = np.zeros(len(plan.poses) - 1, np.bool_)
    for time_s, pose, _, motion in drive(name, space, plan.poses, reverse, start, 30.0):
        at = space.to_cells(pose)
        assert not space.collides(np.array([[at.x_m, at.y_m, at.theta_rad]])).any()
        if motion.arrived:
            assert math.dist((pose.x_m, pose.y_m), (goal.x_m, goal.y_m)) < 0.07
            assert time_s < 2.0 * plan.length_m / 0.8 + 2.0
            return
    pytest.fail(f"not there, but at {pose}")
