"""Kernels that do not count references to arrays leave none behind, by numba's own count."""

import math

import numpy as np
import pytest
from numba.core.runtime import _nrt_python

from robotctl.control.limiter import LimitsConfig
from robotctl.estimation.ranging.sonar_cones import SonarCones
from robotctl.estimation.ranging.wall_echoes import WallEchoes
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.wall_map import WallMap
from robotctl.planning.map.layered_map import LayeredMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.plan import Plan, PlannerConfig
from robotctl.planning.path.global_planning.planners import PLANNERS
from robotctl.planning.path.local.controller import ControllerConfig, LocalSituation
from robotctl.planning.path.local.controllers import CONTROLLERS

BODY = Footprint(((0.25, -0.2), (0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2)))
SIDE_M = 0.05
SOMEBODY = np.array([[3.5, 2.6, -0.5, 0.0, 0.2]])


@pytest.fixture
def held():
    """Return how many arrays of compiled code have been made and not been freed since the start."""
    _nrt_python.memsys_enable_stats()
    yield lambda: _nrt_python.memsys_get_stats_mi_alloc() - _nrt_python.memsys_get_stats_mi_free()
    _nrt_python.memsys_disable_stats()


def cells():
    """Return a room of 6 m by 4 m with a post."""
    grid = np.zeros((80, 120), np.int8)
    grid[38:42, 70:74] = 100
    return grid


def followed(name):
    """Return a step of a controller beside a post and somebody who walks."""
    limits = LimitsConfig(2.0, 4.0, 4.0, 12.0, 40.0, 150.0)
    drive = DifferentialDrive("differential", 0.37, 0.1, 2400)
    controller = CONTROLLERS[name](ControllerConfig(), drive, limits, BODY)
    path = np.array([[1.0, 2.0, 0.0], [5.0, 2.0, 0.0]])
    space = PlanningMap(GridMap(cells(), SIDE_M), BODY)
    situation = LocalSituation(
        SE2(2.6, 2.0, 0.0), Twist(0.8, 0.0), path, np.zeros(1, bool), space, SOMEBODY, 1.0
    )
    return lambda: controller.step(situation)


def planned(name):
    """Return a search of a planner round a post."""
    planner = PLANNERS[name](PlannerConfig(steering="reeds-shepp", turning_radius_m=0.5))
    space = PlanningMap(GridMap(cells(), SIDE_M), BODY)
    return lambda: planner.plan(space, SE2(1.0, 2.0, 0.0), SE2(5.0, 2.0, 1.0))


def seen():
    """Return a scan that the live map takes."""
    live = LayeredMap(GridMap(cells(), SIDE_M), BODY)
    angles = np.linspace(-math.pi, math.pi, 90)
    scan = RangeScan(0, angles, np.full(90, 1.5), 8.0)
    return lambda: live.see_scan(SE2(2.0, 2.0, 0.0), scan, 0, SOMEBODY)


def heard():
    """Return the echoes of a sonar in a room with a corner."""
    walls = WallMap(np.array([[0.0, 0.0, 4.0, 0.0], [4.0, 0.0, 4.0, 3.0]]))
    cones = SonarCones(np.zeros((1, 3)), math.radians(30.0), math.radians(40.0), 3.0)
    echoes = WallEchoes(walls, cones)
    poses = np.column_stack([np.linspace(1.0, 3.0, 20), np.ones(20), np.linspace(-3.0, 3.0, 20)])
    return lambda: echoes.ranges(poses, np.array([0]))


WORK = {
    "dwa": lambda: followed("dwa"),
    "mppi": lambda: followed("mppi"),
    "astar": lambda: planned("astar"),
    "hybrid": lambda: planned("hybrid"),
    "live map": seen,
    "sonar": heard,
}


@pytest.mark.parametrize("name", WORK)
def test_nothing_is_left_of_the_arrays_of_a_step(name, held):
    work = WORK[name]()
    last = work()  # compiles, and makes what it keeps
    before = held()
    for _ in range(3):
        last = work()
    assert held() == before
    assert not isinstance(last, Plan) or len(last.poses)
