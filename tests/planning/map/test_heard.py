"""Who is heard to come: only along the robot's own line, and not walls."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.map.heard import RADIUS_M, heard_walkers

RING = [
    SonarMount(str(deg), 0.2 * math.cos(math.radians(deg)), 0.2 * math.sin(math.radians(deg)), deg)
    for deg in range(0, 360, 45)
]
STANDS = (math.inf, 0.0)


def heard(pose, approaches, *, explained=False):
    """Return who is heard; `approaches` by the heading of the sonar [deg]."""
    all_of = [approaches.get(round(math.degrees(each.heading_rad)), STANDS) for each in RING]
    return heard_walkers(pose, RING, all_of, lambda points: np.full(len(points), explained))


@given(
    st.floats(-9.0, 9.0), st.floats(-9.0, 9.0), st.floats(-3.0, 3.0),
    st.floats(0.1, 4.0), st.floats(0.4, 2.0), st.sampled_from((1, -1)),
)  # fmt: skip
def test_who_comes_along_the_line_is_where_the_echo_is_and_walks_towards_the_sonar(
    x, y, heading, range_m, speed_m_s, side
):
    at_deg = 0 if side > 0 else round(math.degrees(RING[4].heading_rad))
    ((px, py, vx, vy, radius),) = heard(SE2(x, y, heading), {at_deg: (range_m, speed_m_s)})
    away = complex(px - x, py - y) * complex(math.cos(heading), -math.sin(heading))
    assert away == pytest.approx(side * (0.2 + range_m + RADIUS_M), abs=1e-9)
    walks = complex(vx, vy) * complex(math.cos(heading), -math.sin(heading))
    assert walks == pytest.approx(-side * speed_m_s, abs=1e-9)
    assert radius == RADIUS_M


@pytest.mark.parametrize("speed_m_s", [0.0, 0.2, -0.8])
def test_what_stands_or_goes_away_is_nobody_who_comes(speed_m_s):
    assert heard(SE2(), {0: (2.0, speed_m_s)}).shape == (0, 5)


@pytest.mark.parametrize("deg", [45, 90, 135, -45, -90, -135])
def test_what_comes_from_a_side_is_not_met_on_the_way(deg):
    assert heard(SE2(), {deg: (2.0, 0.8)}).shape == (0, 5)


def test_a_wall_of_the_map_does_not_walk():
    assert heard(SE2(), {0: (2.0, 0.8)}, explained=True).shape == (0, 5)
