"""Which share of a scan's echoes a map explains."""

import math

import numpy as np
import pytest

from robotctl.estimation.ranging.echo_share import EchoShare
from robotctl.model.geometry.se2 import SE2
from robotctl.model.grid_map import GridMap
from robotctl.model.sensors.range_scan import RangeScan


def wall(turned_rad=0.0):
    """A map of 10 m x 10 m around the origin with a wall at x = 3 m, turned around the origin."""
    cells = np.zeros((100, 100), np.int8)
    cells[:, 80] = 100
    turn = SE2(0.0, 0.0, turned_rad)
    return GridMap(cells, 0.1, turn @ SE2(-5.0, -5.0, 0.0))


def scan(*ranges, x_m=0.0):
    return RangeScan(0, np.radians(np.linspace(-20, 20, len(ranges))), np.array(ranges), 10.0, x_m)


@pytest.mark.parametrize("turned_rad", [0.0, 0.7, math.pi])
def test_echoes_at_the_wall_are_explained_and_others_not(turned_rad):
    share = EchoShare(wall(turned_rad))
    heading = SE2(0.0, 0.0, turned_rad)
    at_wall = 3.05 / math.cos(math.radians(20))
    assert share(scan(at_wall, 3.05, at_wall), heading) == 1.0
    assert share(scan(at_wall, 2.0, at_wall), heading) == pytest.approx(2 / 3)
    assert share(scan(at_wall, math.inf, math.nan), heading) == 1.0
    assert share(scan(9.0, 9.0, 3.05), heading @ SE2(0.0, 0.0, 0.2)) == 0.0
    assert share(scan(1.0, 2.05, 1.0, x_m=1.0), heading) == pytest.approx(1 / 3)


def test_a_scan_without_an_echo_says_nothing():
    assert EchoShare(wall())(scan(math.inf, math.nan, 10.0), SE2()) is None
