"""A robot of points and numbers that drives journeys in rooms of cells, with a lidar of rays."""

import math
from functools import lru_cache

import numpy as np
from numba import njit

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, Status
from robotctl.planning.behave.journey.pilot import MapPilot
from robotctl.planning.config import NavigationConfig
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.map.seen import Seen
from robotctl.planning.path.global_planning.goal import Goal

SIDE_M = 0.05
BODY = Footprint(((0.2, -0.15), (0.2, 0.15), (-0.15, 0.15), (-0.15, -0.15)))
LIMITS = LimitsConfig(v_max_m_s=0.8, omega_max_rad_s=2.0, a_max_m_s2=2.0, alpha_max_rad_s2=6.0)
DRIVE = DifferentialDrive("differential", 0.3, 0.05, 2400)
DT_S = 0.05
BEAMS = np.linspace(-math.pi, math.pi, 180, endpoint=False)
REACH_M = 8.0
START = SE2(1.0, 2.0, 0.0)


def room(width_m=6.0, height_m=4.0):
    """Return the cells of a room with walls around."""
    cells = np.zeros((round(height_m / SIDE_M), round(width_m / SIDE_M)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return cells


def two_rooms(door_m):
    """Return two rooms with a door about (3, 2)."""
    cells = room()
    cells[:, 60] = 100
    half = round(0.5 * door_m / SIDE_M)
    cells[40 - half : 40 + half, 60] = 0
    return cells


@njit(cache=True)
def walk(cells, x_m, y_m, angles):
    """Return how far a beam of each angle goes, in steps of a fifth of a cell."""
    ranges = np.full(len(angles), math.inf)
    for beam in range(len(angles)):
        ux, uy = math.cos(angles[beam]), math.sin(angles[beam])
        for step in range(round(REACH_M / (0.2 * SIDE_M))):
            away = 0.2 * SIDE_M * step
            row = math.floor((y_m + away * uy) / SIDE_M)
            column = math.floor((x_m + away * ux) / SIDE_M)
            if not (0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]):
                break
            if cells[row, column] > 0:
                ranges[beam] = away
                break
    return ranges


def scan_of(cells, pose, stamp_ns, beams=BEAMS):
    """Return what a lidar at `base` sees."""
    ranges = walk(cells, pose.x_m, pose.y_m, pose.theta_rad + beams)
    return RangeScan(stamp_ns, beams.copy(), ranges, REACH_M)


@lru_cache(maxsize=4)
def space_of(cells, shape):
    """Return what the body may touch in a world of these cells."""
    return PlanningMap(GridMap(np.frombuffer(cells, np.int8).reshape(shape), SIDE_M), BODY)


class Bench:
    """A robot in a true world, with a map of it or none."""

    def __init__(self, world, grid=None, start=START, config=None, beams=BEAMS, **kwargs):
        self.world = world
        self.pose, self.twist, self.now_ns = start, Twist(0.0, 0.0), 0
        given = None if grid is None else GridMap(grid, SIDE_M)
        self.pilot = MapPilot(
            config or NavigationConfig(), DRIVE, LIMITS, BODY, (), given, start,
            lidars=1, **kwargs,
        )  # fmt: skip
        self.beams = beams
        self.sees = True
        self.texts = []

    def look(self):
        """Give the pilot a scan."""
        scans = ((self.pose, scan_of(self.world, self.pose, self.now_ns, self.beams)),)
        self.pilot.see(self.pose, Seen(SE2(), scans if self.sees else ()), self.now_ns)

    def move(self, v, omega, *, checked=True):
        """Move for a step, with the accelerations of the limits; the body must stay free."""
        v += max(min(v - self.twist.v_m_s, 2.0 * DT_S), -2.0 * DT_S) - (v - self.twist.v_m_s)
        turn = max(min(omega - self.twist.omega_rad_s, 6.0 * DT_S), -6.0 * DT_S)
        self.twist = Twist(v, self.twist.omega_rad_s + turn)
        self.pose = self.pose @ SE2.exp(v * DT_S, 0.0, self.twist.omega_rad_s * DT_S)
        self.now_ns += round(DT_S * 1e9)
        if not checked:
            return
        space = space_of(self.world.tobytes(), self.world.shape)
        here = space.to_cells(self.pose)
        assert not space.collides(np.array([[here.x_m, here.y_m, here.theta_rad]]))[0], self.pose

    def drive(self, *goal, seconds=60.0, speed_m_s=0.8, each=lambda _: None):
        """Drive to a goal; return how that ended, or None if it has not."""
        journey = self.pilot.journey(Goal(*goal), speed_m_s)
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.look()
            each(self)
            step = journey.step(BehaviourInput(self.pose, self.twist, (), ()), self.now_ns)
            self.texts.append(step.text)
            if step.status is not Status.RUNNING:
                return step
            self.move(step.v_m_s, step.omega_rad_s)
        return None
