"""The motor drive of docs/extending.md passes the contract of all drives, is found and budgeted."""

import pytest

from robotctl.config.robot_file import config_directory, find_file
from robotctl.drivers.can.nodes import registry
from robotctl.messages.faults import FaultCode
from robotctl.safety.state_machine import POWERED
from tests.app.simulation.test_bad_input_of_drives import Robot, changed, nothing, reset
from tests.cli.command import status_of
from tests.drivers.can.drives.scan_bench import ScanBench

NAME = "mc1"


@pytest.fixture(autouse=True)
def without_bumpers(monkeypatch):
    """Leave out the bumpers of the page, which nothing simulates."""
    nodes = tuple(node for node in registry.CAN_NODES if node.name != "bumper")
    monkeypatch.setattr(registry, "CAN_NODES", nodes)


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


class Count:
    """Counts the tests that pass."""

    passed = 0

    def pytest_runtest_logreport(self, report):
        self.passed += report.when == "call" and report.passed


def test_it_keeps_the_contract_of_all_drives():
    count = Count()
    names = f"{NAME} or each_kind_of_drive_has"
    contract = "tests/drivers/can/drives/test_contract.py"
    assert pytest.main(["-q", "-p", "no:cacheprovider", "-k", names, contract], [count]) == 0
    assert count.passed >= 14


def test_a_scan_finds_it_without_moving_it():
    bench = ScanBench()
    for number in (3, 7):
        bench.add(NAME, number)
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
    assert control.fault is code, control.reason
    assert words in control.reason
