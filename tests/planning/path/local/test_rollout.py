"""The places that a rollout draws are those that the robot can reach."""

import numpy as np
import pytest

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import DifferentialDrive
from robotctl.model.footprint import Footprint
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.grid_map import GridMap
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.local.controller import ControllerConfig, LocalSituation
from robotctl.planning.path.local.follower import Choice, Follower
from robotctl.planning.path.local.rollout import cheapest

SIDE_M = 0.05
BODY = Footprint(((0.25, -0.2), (0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2)))


class StraightOn:
    """Asks for one velocity, and keeps what is drawn."""

    steps = 20

    def reset(self):
        pass

    def choose(self, problem, effort):
        self.drawn = np.full((self.steps, 3), np.nan)
        targets = np.array([[[problem.v, 0.0, 0.0]]])
        _, v, omega, vy = cheapest(problem, targets, self.drawn)
        return Choice(v, omega, self.drawn, vy)


@pytest.mark.parametrize("gap_m", [0.01, 0.3, 1.0])
def test_what_is_drawn_ahead_ends_before_the_wall_whenever_that_is_touched(gap_m):
    cells = np.zeros((80, 120), np.int8)
    cells[:, 60:] = 100  # a wall from x = 3 m on
    drive = DifferentialDrive("differential", 0.37, 0.1, 2400)
    limits = LimitsConfig(2.0, 4.0, 4.0, 12.0, 40.0, 150.0)
    search = StraightOn()
    follower = Follower(ControllerConfig(), drive, limits, BODY, search)
    pose = SE2(3.0 - 0.25 - gap_m, 2.0, 0.0)
    path = np.array([[pose.x_m, 2.0, 0.0], [5.5, 2.0, 0.0]])
    space = PlanningMap(GridMap(cells, SIDE_M), BODY)
    situation = LocalSituation(
        pose, Twist(1.5, 0.0), path, np.zeros(2, bool), space, np.empty((0, 5)), 2.0
    )
    follower.step(situation)
    x, y, heading = search.drawn.T
    assert np.isfinite(search.drawn).all()
    # The velocity of the last command is driven for a moment before the next takes effect.
    assert (x * SIDE_M <= max(3.0 - 0.25, pose.x_m + 1.5 * 0.2)).all()
    assert np.abs(y * SIDE_M - 2.0).max() < 0.05
    assert np.abs(heading).max() < 0.05
