"""How the tests of faults judge: by which reason, and from when on the wheels are without power."""

from __future__ import annotations

import can
import pytest

from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import Protector
from hil_tests.bus_tool import COMMAND, EMCY_DRIVE
from hil_tests.fault_rows import ROWS
from hil_tests.test_12_robot_faults import without_power_s
from robotctl.messages.faults import FaultCode

FAULTS = {
    "encoder": (FaultCode.ENCODER_REVERSED, "left"),
    "other encoder": (FaultCode.ENCODER_REVERSED, "right"),
    "feedback": (FaultCode.WHEELS_STALE, "drive"),
    "pair": (FaultCode.WHEELS_CONTRADICT, ""),
    "sonar": (FaultCode.WHEELS_SLIP, "front"),
    "sonar node": (FaultCode.NODE_SILENT, "sonar"),
    "nothing": (FaultCode.NONE, ""),
    "clock": (FaultCode.CLOCK_DRIFT, "drive"),
    "battery": (FaultCode.BATTERY_CRITICAL, ""),
}


def row(name: str):
    (found,) = (each for each in ROWS if each.name == name)
    return found


@pytest.mark.parametrize(
    ("name", "explained"),
    [
        ("encoder_stuck wheel=right", set()),
        ("encoder_reversed wheel=left", {"encoder"}),
        ("encoder_disconnected wheel=left", {"encoder"}),
        ("wheels_swapped", set()),
        ("wheel_blocked wheel=left", set()),
        ("over_current amperes=30", {"encoder", "other encoder"}),
        ("under_voltage volts=6", set()),
        ("node_silent node=drive", {"feedback"}),
        ("node_reset node=drive", {"feedback"}),
        ("node_silent node=sonar", {"sonar node"}),
        ("sonar_silent", set()),
        ("parameter_lost node=drive", {"feedback"}),
    ],
)
def test_a_fault_is_explained_by_the_guards_that_can_see_it_alone(
    name: str, explained: set[str]
) -> None:
    assert {kind for kind, fault in FAULTS.items() if row(name).explains(*fault)} == explained


def test_a_command_counts_as_a_stop_only_where_the_drive_takes_it_for_one() -> None:
    protector = Protector(wire.data_id(wire.MOTOR_COMMAND))
    go, stop = (protector.protect(enable << 12) for enable in (1, 0))
    damaged = bytes((go[0], go[1] ^ 0x10, *go[2:]))

    def frame(stamp_s: float, arbitration_id: int, data: bytes) -> can.Message:
        return can.Message(
            timestamp=stamp_s, arbitration_id=arbitration_id, data=data, is_extended_id=False
        )

    timed_out = frame(3.0, EMCY_DRIVE, bytes((0x30, 0x81, *6 * (0,))))
    heard = [frame(1.0, COMMAND, go), frame(2.0, COMMAND, damaged), timed_out]
    assert without_power_s(heard, 0.5) == 3.0
    assert without_power_s([*heard[:1], frame(2.0, COMMAND, stop), timed_out], 0.5) == 2.0
