"""Following a path."""

from robotctl.model.geometry.se2 import SE2
from tests.planning.bench import AUTO, ahead, mission


def test_a_robot_far_from_its_path_gives_up(robot, make_run):
    run = make_run(robot, mission=mission(ahead(3.5)), start=SE2(1.0, 2.0, 0.0))
    out = run.step(AUTO)
    assert out.state.mission_failed
    assert "1.00 m off the path" in out.state.message
    assert out.v_m_s == 0.0
