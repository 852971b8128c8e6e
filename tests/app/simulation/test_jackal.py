"""The robot without sonars: as fast as its file says, without an objection of its monitors."""

from pathlib import Path

import pytest

from robotctl.app.simulation.lockstep import LockstepRun
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.messages.control import SafetyState

MISSION = """
name = "there and round"
world = "hall"
start = { x_m = 1.0, y_m = 2.0, heading_deg = 0.0 }

[[item]]
kind = "drive"
waypoints = [[1.0, 2.0], [10.0, 2.0]]
speed_m_s = 2.0

[[item]]
kind = "turn_to"
heading_deg = 170.0
"""
AT_ITS_LIMITS = (
    "navigation.pursuit.acceleration_m_s2=4.0",
    "navigation.pursuit.alpha_rad_s2=15.0",
)


def test_it_drives_and_turns_at_its_limits(tmp_path: Path) -> None:
    mission = tmp_path / "mission.toml"
    mission.write_text(MISSION)
    run = LockstepRun(SimOptions(find_file("jackal"), mission, overrides=AT_ITS_LIMITS))
    plant, speeds_m_s, states = run.stack.simulation.plant, [0.0], set()
    for control, _ in run.steps():
        speeds_m_s.append(plant.v_m_s)
        states.add(control.state)
    assert max(speeds_m_s) == pytest.approx(2.0, rel=0.02)
    gained_m_s = [after - before for before, after in zip(speeds_m_s, speeds_m_s[5:], strict=False)]
    assert max(gained_m_s) > 0.25 * 3.0
    assert min(gained_m_s) < -0.25 * 3.0
    assert SafetyState.FAULT not in states
    assert plant.x_m == pytest.approx(10.0, abs=0.25)
    assert plant.theta_rad == pytest.approx(2.967, abs=0.05)
