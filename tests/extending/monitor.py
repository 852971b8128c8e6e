"""The monitor of docs/extending.md stops a robot whose bumper touches something."""

import msgspec
import pytest
from robotctl.safety.contact import ContactMonitor

from robotctl.core.checkpoint import checkpoint, restored
from robotctl.messages.control import BumperFeedback, SafetyState
from robotctl.messages.faults import FaultCode
from tests.core.robot_double import RobotDouble


class Bumped(RobotDouble):
    touching = None

    def _feedback(self):
        bumper = BumperFeedback(
            self.now_ns, front=self.touching == "front", rear=self.touching == "rear"
        )
        return msgspec.structs.replace(super()._feedback(), bumper=bumper)


@pytest.mark.parametrize("part", ["front", "rear"])
def test_contact_stops_the_robot(part):
    robot = Bumped().armed()
    robot.ticks(100, (0.3, 0.0))
    assert robot.state == SafetyState.DRIVING
    robot.touching = part
    robot.ticks(1, (0.3, 0.0))
    state = robot.snapshot()
    assert (state.state, state.fault) == (SafetyState.FAULT, FaultCode.BUMPER_HIT)
    assert (state.fault_part, state.reason) == (part, f"the {part} bumper touches something")
    assert not robot.outputs.command.enable


def test_it_is_part_of_the_flight_recorders_checkpoints():
    core = restored(checkpoint(Bumped().armed().core))
    assert any(isinstance(each, ContactMonitor) for each in core._supervision._monitors)
