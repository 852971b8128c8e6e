"""MAVLink items as items of ours, against the definition of their commands."""

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.translate import MissionContext, translate
from robotctl.model.geometry.se2 import SE2

AROUND = MissionContext(SE2(), None, plans=True)
HOME = MissionItem(m.MAV_CMD_NAV_WAYPOINT, m.MAV_FRAME_LOCAL_NED, (0.0, 0.0, 0.0, 0.0), 0, 0, 0)


@pytest.mark.parametrize(("radius_m", "side"), [(2.0, "right"), (-0.5, "left")])
def test_a_circle_is_clockwise_where_its_radius_is_positive(radius_m, side):
    # https://mavlink.io/en/messages/common.html#MAV_CMD_NAV_LOITER_TURNS
    speed = HOME._replace(command=m.MAV_CMD_DO_CHANGE_SPEED, params=(1.0, 0.25, 0.0, 0.0))
    turns = m.MAV_CMD_NAV_LOITER_TURNS
    circle = HOME._replace(command=turns, params=(3.0, 0.0, radius_m, 0.0), x=3.0, y=1.5)
    (found,) = translate([HOME, speed, circle], AROUND).items
    assert found == {
        "kind": "circle",
        "x_m": 1.5,  # x is east, y is north
        "y_m": 3.0,
        "turns": 3.0,
        "radius_m": abs(radius_m),
        "side": side,
        "speed_m_s": 0.25,
    }
