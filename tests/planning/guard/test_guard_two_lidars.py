"""A robot with a lidar at the nose and one at the tail stops before what either sees."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from robotctl.messages.mode import Mode
from robotctl.messages.requests import ModeRequest, VelocityRequest
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.planning.config import NavigationConfig
from robotctl.planning.navigation_step import NavigationInputs
from robotctl.planning.navigator import Navigator
from tests.planning.conftest import cast
from tests.planning.guard.test_guard_sideways import FAR, GUARD, LATER, LIMITS, NOSE, room

HALF = np.radians(np.linspace(-90.0, 90.0, 181))
MOUNTS = {"front": (0.2, 0.0), "rear": (-0.2, math.pi)}
DRIVE = DifferentialDrive("differential", 0.40, 0.076, 8192)
STEP_S = 0.05


class Shuttle:
    """A robot that drives to and fro along x; its lidars take turns, one in each step."""

    def __init__(self, walls, lidars=tuple(MOUNTS)):
        self.walls, self.lidars, self.x_m, self.v_m_s, self.step_number = walls, lidars, 0.0, 0.0, 0
        limits = replace(LIMITS, vy_max_m_s=0.0)
        self.navigator = Navigator(
            NavigationConfig(guard=GUARD), DRIVE, limits, (), None, FAR, lidars=2
        )
        self.step(ModeRequest(Mode.GUIDED))

    def scan(self, name):
        at, heading = MOUNTS[name]
        angles = heading + HALF
        place = np.full(len(angles), self.x_m + at), np.zeros(len(angles))
        hits = cast(self.walls, *place, angles)[:, 0]
        return RangeScan(self.step_number * 50_000_000, angles, hits, 10.0, at, name=name)

    def step(self, *requests):
        name = list(MOUNTS)[self.step_number % 2]
        pose = SE2(self.x_m, 0.0, 0.0)
        scans = ((pose, self.scan(name)),) if name in self.lidars else ()
        inputs = NavigationInputs(pose, Twist(self.v_m_s, 0.0), (), (), True, requests, scans=scans)
        out = self.navigator.step(inputs, self.step_number * 50_000_000)
        self.v_m_s += np.clip(out.v_m_s - self.v_m_s, -2.0 * STEP_S, 2.0 * STEP_S)
        self.x_m += self.v_m_s * STEP_S
        self.step_number += 1
        return out

    def drive(self, v_m_s, steps=200):
        for _ in range(steps):
            out = self.step(VelocityRequest(LATER, v_m_s, 0.0))
        return out


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_it_stops_before_a_post_that_only_one_of_them_sees(sense):
    robot = Shuttle(room((sense * 1.5, 0.0)))
    robot.drive(sense * 0.5)
    gap_m = 1.5 - 0.06 - NOSE - abs(robot.x_m)
    assert robot.v_m_s == pytest.approx(0.0, abs=1e-3)
    assert 0.02 < gap_m < 0.4  # it came near, and no nearer


@pytest.mark.parametrize("heard", ["front", "rear"])
def test_with_one_of_two_silent_from_the_start_it_does_not_move(heard):
    robot = Shuttle(room(), lidars=(heard,))
    out = robot.drive(0.5)
    assert robot.x_m == 0.0
    assert "the lidar gives no scans" in out.state.message


def test_when_one_falls_silent_it_stops():
    robot = Shuttle(room())
    robot.drive(0.3, 20)
    assert robot.v_m_s > 0.2
    robot.lidars = ("front",)
    robot.drive(0.3, 40)
    assert robot.v_m_s == pytest.approx(0.0, abs=1e-3)
