"""What the instruments of a ground station show."""

import math

import pytest
from pymavlink.dialects.v20 import common as m


def hud(bench, **control):
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_VFR_HUD)
    bench.step(bench.control(**control))
    return [(x.groundspeed, x.heading, x.throttle) for x in bench.messages("VFR_HUD")]


@pytest.mark.parametrize(
    ("theta", "heading"), [(0.0, 90), (math.pi / 2, 0), (math.pi, 270), (-math.pi / 2, 180)]
)
def test_speed_compass_heading_and_power(bench, theta, heading):
    for v_m_s in (0.5, -0.5):
        found = hud(bench, v_m_s=v_m_s, theta_rad=theta, duty=(0.25, -0.75))
        assert found[0] == (0.5, heading, 50)


def test_what_is_not_known_is_not_shown(bench):
    assert hud(bench, v_m_s=math.nan) == []
    assert hud(bench, theta_rad=math.nan) == []


def test_a_rover_is_on_the_ground(bench):
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
    bench.step(bench.control())
    assert bench.messages("EXTENDED_SYS_STATE")[0].landed_state == m.MAV_LANDED_STATE_ON_GROUND
