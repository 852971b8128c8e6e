"""The motor drive of docs/extending.md passes the contract of all drives, is found and budgeted."""

import subprocess
import sys

import pytest

from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.registry import TWINS
from robotctl.config.robot_file import config_directory, find_file, load_robot
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode
from robotctl.safety.state_machine import POWERED
from tests.app.simulation.test_bad_input_of_drives import Robot, changed, nothing, reset
from tests.cli.command import status_of
from tests.drivers.can.drives.scan_bench import ScanBench

NAME = "mc1"


@pytest.fixture(scope="module", autouse=True)
def robot_file():
    """Make the robot file that the page asks for."""
    text = find_file("odrive").read_text(encoding="utf-8")
    for before, after in (
        ('name = "odrive"', 'name = "mc1"'),
        ('kind = "odrive"', 'kind = "mc1"'),
        ("node_id = 33 ", "node_id = 1 "),
        ("node_id = 34 ", "node_id = 2 "),
    ):
        assert before in text
        text = text.replace(before, after)
    text = text.split("[simulation.twin", 1)[0]
    (config_directory() / f"{NAME}.toml").write_text(text, encoding="utf-8")


def test_it_keeps_the_contract_of_all_drives():
    names = f"({NAME} or each_kind_of_drive_has) and not native"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", names,
         "tests/drivers/can/drives/test_contract.py"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert int(done.stdout.split(" passed")[0].split()[-1]) >= 15, done.stdout


def test_a_scan_finds_it_without_moving_it_and_suggests_its_table():
    bench = ScanBench()
    for number, wheel in ((3, "front_left"), (7, "front_right")):
        table = TWINS[NAME](NAME, f"mc1_{number}", (AxisSection(wheel),), node_id=number)
        bench.plug(table, TWINS[NAME].Settings())
    found = [each for each in bench.scan().found if each.kind == NAME]
    assert [(each.number, each.firmware) for each in found] == [(3, "1"), (7, "1")]
    assert not any(axis.powered for axis in bench.plant.axes)


def test_the_budget_of_the_bus_has_its_frames(capsys):
    assert status_of("can", "budget", "--robot", NAME) == 0
    shown = capsys.readouterr().out
    assert "left_drive command" in shown
    assert "right_drive status" in shown


@pytest.mark.parametrize(
    ("act", "code", "words", "settings"),
    [
        (changed(0x0A00_0101, lambda data: data[:-1]), FaultCode.DRIVE_UNREADABLE, "its status",
         ()),
        (nothing, FaultCode.NODE_OTHER_FIRMWARE, "firmware 2 is not known",
         ("simulation.twin.left_drive.firmware=2",)),
        (lambda robot: setattr(robot.twin, "timeout_ms", 500), FaultCode.NODE_CHANGED,
         "it was changed", ()),
        (reset, FaultCode.NODE_RESTARTED, "restarted", ()),
        (lambda robot: robot.twin.trip(1), FaultCode.DRIVE_OVER_CURRENT, "over-current", ()),
    ],
)  # fmt: skip
def test_what_goes_wrong_with_it_stops_the_robot_with_its_cause(act, code, words, settings):
    robot = Robot(NAME, settings)
    if robot.arm():
        robot.drive(0.5)
        act(robot)
        robot.drive(1.5)
    control = robot.stack.snapshot()
    assert control.state not in POWERED
    assert control.state in (SafetyState.FAULT, SafetyState.BOOT)
    assert control.fault is code, control.reason
    assert words in control.reason
    assert load_robot(find_file(NAME)).motors[0].kind == NAME
