"""Who can press the emergency stop, and what must hold after it."""

from __future__ import annotations

import signal
from collections.abc import Callable

import can

from hil_tests.bus_tool import EMERGENCY_STOP
from hil_tests.rig import Rig
from robotctl.app.supervision.stack import CONTROL
from robotctl.messages.control import SafetyState

OPERATOR_FRAME = can.Message(arbitration_id=EMERGENCY_STOP, data=b"\x01", is_extended_id=False)
ON_THE_BUS = "frame on the bus"
SOURCES: dict[str, Callable[[Rig], None]] = {
    ON_THE_BUS: lambda rig: rig.observer.send(OPERATOR_FRAME),
    "request of a process": Rig.emergency_stop,
    "SIGUSR1": lambda rig: rig.send_signal(CONTROL, signal.SIGUSR1),
}


def assert_latched(rig: Rig) -> None:
    """Assert that commands move nothing until the robot has been armed, and then do."""
    rig.at_rest()
    before = rig.fresh_truth()
    rig.drive(0.4, 0.8, 0.5)
    assert rig.control.state == SafetyState.EMERGENCY_STOP
    assert rig.fresh_truth().distance_m - before.distance_m < 1e-3
    rig.arm()
    rig.drive(0.3, 0.8, 1.0)
    assert rig.fresh_truth().distance_m - before.distance_m > 0.1
