"""EMCY codes are told in words, the firmware's own each by its fault."""

import pytest

from firmware_sim.nodes.drive import EMERGENCY_STOP_TROUBLE, TROUBLES
from firmware_sim.nodes.drive_guards import DriveFault
from firmware_sim.nodes.power import BATTERY_CRITICAL
from robotctl.safety.emergency_codes import emergency_words

WORDS = {
    DriveFault.OVER_CURRENT: "over current",
    DriveFault.OVER_TEMPERATURE: "over temperature",
    DriveFault.UNDER_VOLTAGE: "under voltage",
    DriveFault.ENCODER: "encoder",
    DriveFault.COMMAND_TIMEOUT: "command time-out",
    DriveFault.PARAMETER: "stored parameters are lost",
}


@pytest.mark.parametrize("fault", list(DriveFault))
def test_each_fault_of_the_motor_controller_is_called_by_its_name(fault):
    assert WORDS[fault] in emergency_words(TROUBLES[fault].code)


def test_emergency_stop_and_an_empty_battery_have_words():
    assert emergency_words(EMERGENCY_STOP_TROUBLE.code) == "emergency stop"
    assert emergency_words(BATTERY_CRITICAL.code) == "under voltage"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x1000, "generic error"),
        (0x2311, "current at the output"),
        (0x2012, "current"),
        (0x3130, "mains voltage"),
        (0x4F00, "temperature"),
        (0x5001, "hardware"),
        (0x6320, "data set"),
        (0x7000, "additional module"),
        (0x8200, "protocol"),
        (0x8F00, "monitoring"),
        (0x9000, "external error"),
        (0xF001, "additional functions"),
        (0xFF77, "device's own error"),
        (0xA000, "a code of no standard"),
        (0x0001, "a code of no standard"),
    ],
)
def test_codes_of_other_devices_are_told_by_their_group_or_class(code, words):
    assert emergency_words(code) == words
