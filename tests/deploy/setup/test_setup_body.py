"""How far the robot reaches: what is right stays, what is not becomes an outline."""

import pytest

from robotctl.deploy.setup.dialogue import Topic
from tests.deploy.setup.setup_rig import STEP, SetupRig

TRUE = "body = [[0.254, 0.215], [-0.254, 0.215], [-0.254, -0.215], [0.254, -0.215]]"
WITH_ARM = "body = [[0.254, 0.215], [-0.254, 0.215], [-0.254, -0.4], [0.254, -0.4]]"


@pytest.mark.parametrize("robot", ["diff_drive", "tricycle", "mecanum"])
def test_what_is_right_stays(tmp_path, robot):
    rig = SetupRig(tmp_path, robot)
    assert rig.run("body") == [True]
    assert rig.file.read_text() == rig.before


def test_an_arm_that_nobody_entered_is_part_of_the_outline(tmp_path):
    rig = SetupRig(tmp_path, "mecanum", believed=((TRUE, WITH_ARM),))
    assert rig.run("body") == [True]
    body = rig.config.footprint
    assert (body.front_m, body.rear_m, body.left_m, body.right_m) == (0.254, -0.254, 0.225, 0.4)
    assert "nose_m" not in rig.file.read_text()
    rig.guide.undo(STEP["body"])
    assert rig.config.footprint == SetupRig(tmp_path, "mecanum").config.footprint


def test_measures_that_cannot_be_are_asked_for_again(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.person.script[Topic.BODY] = ["-0.3", "30", "0.3"]
    assert rig.run("body") == [True]
    assert rig.config.footprint.front_m == 0.3
    assert rig.heard("-0.3 found, above 0 to 10 m allowed")
    assert rig.heard("30 found, above 0 to 10 m allowed")


def test_an_outline_that_leaves_out_a_sonar_is_refused(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.person.script[Topic.BODY] = ["0.05"]
    assert rig.run("body") == [False]
    assert rig.heard("sonar front")
    assert rig.file.read_text() == rig.before
