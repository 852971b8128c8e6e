"""Two loops that drive each other's wheel: told from one wheel that runs away alone."""

from __future__ import annotations

import pytest

from robotctl.messages.actuators import ActuatorCommand, ActuatorFeedback
from robotctl.messages.faults import FaultCode
from robotctl.model.actuators import Abilities, Actuator, Takes
from robotctl.safety.plausibility import Plausibility
from tests.safety.monitored import inputs, monitored

MS = 1_000_000
SPEED = Abilities(Takes.SPEED, stops_alone=True, brakes=True)
NAMES = ("front_left", "front_right", "rear_left", "rear_right")
WHEELS = tuple(Actuator(name, name, Takes.SPEED, 4096, SPEED) for name in NAMES)
WANTED = (4.0, 6.0, 4.0, 6.0)


def found(speeds_rad_s, reports=4, wanted=WANTED):
    """Return what the monitor says of speeds that stay so for some reports, 5 ms apart."""
    monitor = Plausibility(monitored(WHEELS))
    angles = [0.0] * 4
    fault = None
    for number in range(1, reports + 1):
        stamp_ns = number * 5 * MS
        angles = [a + 0.005 * w for a, w in zip(angles, speeds_rad_s, strict=True)]
        told = tuple(ActuatorFeedback(motion_ns=stamp_ns) for _ in WHEELS)
        command = ActuatorCommand(enable=True, values=wanted)
        fault = monitor.update(inputs(told, command, speeds_rad_s, angles_rad=tuple(angles)))
    return fault


def test_a_wheel_that_runs_ahead_and_one_that_runs_backwards_are_swapped():
    fault = found((30.0, -20.0, 4.0, 6.0))
    assert fault.code is FaultCode.ENCODERS_SWAPPED
    assert fault.text == "front_left and front_right encoders are swapped, or both reversed"


def test_one_report_is_not_enough():
    assert found((30.0, -20.0, 4.0, 6.0), reports=1) is None


@pytest.mark.parametrize(
    "speeds_rad_s",
    [
        (30.0, 6.0, 4.0, 6.0),  # one alone
        (30.0, 40.0, 4.0, 6.0),  # both ahead
        (30.0, 0.0, 4.0, 6.0),  # one ahead, one blocked
        (30.0, -20.0, 30.0, 6.0),  # three
        (-20.0, -20.0, 4.0, 6.0),  # both backwards
    ],
)
def test_whatever_else_happens_to_wheels_is_not_called_a_swap(speeds_rad_s):
    fault = found(speeds_rad_s, reports=30)
    assert fault is None or fault.code is not FaultCode.ENCODERS_SWAPPED
