"""Sonars, IMU, emergency stop and speeds: what is seen, and what is said where it is not."""

import pytest

from robotctl.deploy.setup.dialogue import Topic
from tests.deploy.setup.setup_rig import SetupRig

IMU = ("[imu]\nenabled = false", "[imu]\nenabled = true")


def test_an_imu_that_is_mounted_as_the_file_says_is_found_right(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive", believed=(IMU,))
    assert rig.run("imu") == [True]
    assert rig.heard("Tilted forwards by 2")
    assert rig.heard("Tilted left by 2")
    assert rig.heard("Turned to the left by")


def test_an_imu_that_is_mounted_otherwise_is_said(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive", believed=(IMU,))
    rig.simulation.faults.inject("tilted pitch=0 roll=0")
    hold = rig.person._tilt_or_turn
    rig.person._tilt_or_turn = lambda topic, way: hold(
        topic, "left" if way == "forwards" else "forwards"
    )
    assert rig.run("imu") == [False]
    assert rig.heard("degrees forwards, at least 8 allowed")
    assert rig.heard("imu.yaw_deg")


def test_a_gyro_that_counts_the_other_way_round_is_said(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive", believed=(IMU,))
    do = rig.person._tilt_or_turn

    def turn_right(topic, way):
        if topic is Topic.TURN_LEFT:
            rig.simulation.faults.inject("gyro_biased rate=-0.5 duration=3")
        else:
            do(topic, way)

    rig.person._tilt_or_turn = turn_right
    assert rig.run("imu") == [False]
    assert rig.heard("degrees to the left, at least 20 allowed")


def test_a_hand_before_another_sonar_is_said_with_its_name(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    stand = rig.person._stand_before_a_wall
    swapped = {"left": "right", "right": "left"}
    rig.person._stand_before_a_wall = lambda sonar: stand(swapped.get(sonar, sonar))
    assert rig.run("sonars") == [False]
    assert rig.heard("front_left sees it at 0.2")
    assert rig.heard("the hand before left is seen by right")


def test_silent_sonars_are_said(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.simulation.faults.inject("sonar_silent duration=1000")
    assert rig.run("sonars") == [False]
    assert rig.heard("the hand before front is seen by no sonar")


@pytest.mark.parametrize("robot", ["diff_drive", "odrive", "vesc_car", "zlac8015d"])
def test_an_emergency_stop_that_takes_the_supply_is_seen_and_left_again(tmp_path, robot):
    rig = SetupRig(tmp_path, robot)
    assert rig.run("stop") == [True]
    assert rig.heard("is off the bus")
    assert rig.heard("All drives are ready again.")


def test_an_emergency_stop_that_does_nothing_is_said(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.person._supply = lambda off: None
    assert rig.run("stop") == [False]
    assert rig.heard("nothing shows that the emergency stop is pressed")


def test_an_emergency_stop_that_only_some_drives_show_is_said(tmp_path):
    rig = SetupRig(tmp_path, "odrive")
    rig.person._supply = lambda off: rig.simulation.power_off(rig.simulation.twins[0])
    assert rig.run("stop") == [False]
    assert rig.heard("nothing shows that the emergency stop is pressed")


def test_the_greatest_speed_is_written_in_its_place(tmp_path):
    rig = SetupRig(tmp_path, "odrive")
    rig.person.script[Topic.SPEED] = ["0.4"]
    assert rig.run("speeds") == [True]
    assert rig.config.limits.v_max_m_s == 0.4
    assert rig.heard("At the robot's limits left turns at")
