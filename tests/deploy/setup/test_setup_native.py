"""The guided first day of our own drive, wired otherwise than its file says."""

import tomllib

import pytest

from robotctl.deploy.setup.dialogue import Topic
from robotctl.deploy.setup.registry import STEPS
from tests.deploy.setup.setup_rig import STEP, SetupRig

SWAPPED = [{"actuator": "right", "axis": 1}, {"actuator": "left", "axis": 2}]
REVERSED = [{"actuator": "left", "axis": 1}, {"actuator": "right", "axis": 2, "reversed": True}]
BOTH = [{"actuator": "right", "axis": 1, "reversed": True}, {"actuator": "left", "axis": 2}]


def test_a_robot_wired_as_its_file_says_stays_as_it_is(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    assert rig.guide.walk()
    assert rig.guide.done == {step.name for step in STEPS}
    assert rig.text == rig.before
    assert rig.buses.fastest_m_s > 0.05  # it has been turned
    assert rig.buses.fastest_m_s <= 0.2


@pytest.mark.parametrize("truth", [SWAPPED, REVERSED, BOTH], ids=["swapped", "reversed", "both"])
def test_wrong_wheels_and_directions_are_found_and_put_right(tmp_path, truth):
    rig = SetupRig(tmp_path, "diff_drive", {"drive": {"axes": truth}})
    assert rig.run("nodes", "counts", "directions") == [True, True, True]
    (table,) = rig.tables["motor"]
    assert {"kind": "native", "name": "drive"}.items() <= table.items()
    for axis, found in zip(truth, table["axes"], strict=True):
        assert found == {"reversed": False, **axis}
    for line in rig.before.splitlines():
        assert line in rig.text.splitlines()
    x_m, y_m, theta_rad = rig.drive_straight()
    assert x_m > 0.6
    assert abs(y_m) < 0.05
    assert abs(theta_rad) < 0.05


def test_counts_that_the_drive_has_otherwise_are_written_into_the_file(tmp_path):
    rig = SetupRig(
        tmp_path,
        "diff_drive",
        {"drive": {"counts_per_revolution": 2400}},
        (("counts_per_revolution = 2400 ", "counts_per_revolution = 1200 "),),
    )
    assert rig.run("nodes", "counts") == [True, True]
    assert rig.config.drive.counts_per_revolution == 2400
    assert "counts_per_revolution = 2400    # quadrature counts at the wheel" in rig.text
    assert rig.drive_straight()[0] == pytest.approx(0.3 * 3.0, abs=0.15)


def test_the_drive_stops_by_itself_and_that_needs_no_line(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    assert rig.run("prove") == [True]
    assert rig.heard("drive: power gone after")
    assert "proof" not in rig.tables


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("encoder_reversed wheel=left", "the encoder of left counts backwards"),
        ("encoder_stuck wheel=left", "the encoder of left does not report"),
        ("wheels_swapped", "the motor of left turned, but the encoder of right reports it"),
    ],
)
def test_encoders_that_do_not_belong_to_their_motors_are_said(tmp_path, fault, said):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.simulation.faults.inject(fault)
    assert rig.run("directions") == [False]
    assert rig.heard(said)
    assert rig.text == rig.before


def test_a_wheel_that_no_encoder_reports_is_said_by_the_turn_by_hand(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.simulation.faults.inject("encoder_disconnected wheel=left")
    assert rig.run("counts") == [False]
    assert rig.heard("no drive reports that left turned")


def test_a_drive_that_is_not_there_is_said_with_what_to_do(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.simulation.power_off(rig.simulation.drive)
    assert rig.run("nodes") == [False]
    assert rig.heard("node 1 drive: drive (node 1): not heard")
    assert rig.heard("check its power and cable")


def test_two_axes_that_are_seen_to_turn_one_wheel_are_refused(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.person.script[Topic.WHEEL] = ["left", "left"]
    assert rig.run("directions") == [False]
    assert rig.heard("each axis must turn a wheel of its own")
    assert rig.text == rig.before


def test_a_drive_on_another_bus_stays_there_when_it_is_given_a_table(tmp_path):
    speed = "bitrate = 1_000_000\n"
    second = '\n[[can]]\nname = "wheels"\nchannel = "can1"\n\n[nodes]\ndrive = "wheels"\n'
    believed = (("[can]\n", '[[can]]\nname = "rest"\n'), (speed, f"{speed}{second}"))
    rig = SetupRig(tmp_path, "diff_drive", {"drive": {"axes": REVERSED}}, believed)
    assert rig.run("nodes", "directions") == [True, True]
    assert rig.config.motors[0].bus == "wheels"
    assert "drive" not in rig.tables["nodes"]
    rig.guide.undo(STEP["directions"])
    assert rig.tables == tomllib.loads(rig.before)


def test_a_wheel_that_only_the_host_does_not_see_turn_stays_slow(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    rig.simulation.faults.inject("feedback_frozen")
    assert rig.run("directions") == [False]
    assert rig.heard("the encoder of left does not report that it turned")
    assert rig.buses.fastest_m_s > 0.1


def test_two_wheels_that_are_turned_by_hand_at_once_are_said(tmp_path):
    rig = SetupRig(tmp_path, "diff_drive")
    turn = rig.person._turn_on

    def turn_both(_wheel):
        turn("left")
        rig.simulation.plant.axes[1].turn(0.01)

    rig.person._turn_on = turn_both
    assert rig.run("counts") == [False]
    assert rig.heard("left and right are both reported to have turned")
