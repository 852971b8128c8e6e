"""The bumpers of docs/extending.md: commissioned, read, needed for arming, and seen by doctor."""

from firmware_sim.nodes.e2e import crc8, data_id_crc
from robotctl.app.processes.robot import make_codec
from robotctl.deploy.doctor_nodes import check_node
from robotctl.drivers.can.config import NodeParameters
from robotctl.messages.control import BumperFeedback
from robotctl.messages.faults import FaultCode
from robotctl.runtime.clock import VirtualClock
from robotctl.safety.health import Health
from robotctl.safety.state_machine import SafetyConfig
from tests.drivers.can.nodes.fake_nodes import FakeBus, FakeNode
from tests.drivers.can.nodes.test_registry import (  # noqa: F401 - they hold this entry, too
    test_a_node_has_all_its_services_and_frames_in_the_dbc,
    test_numbers_and_names_are_each_nodes_own,
    test_whatever_a_node_reports_has_a_greatest_age,
)
from tests.native_frames import WHEELS, age_limits

PARAMETERS = NodeParameters(200, 100, 350, sonars=8)
CONTACT, DATA_ID = 389, 41605
FRONT = 0x10


def make_bus():
    bus = FakeBus(make_codec(), PARAMETERS, VirtualClock())
    version = bus.drive.objects[0x2001, 0]
    bus.bumper = FakeNode(bus, 5, {(0x2001, 0): version, (0x1017, 0): 100})
    bus.nodes.append(bus.bumper)
    return bus


def test_it_is_commissioned_and_what_it_sends_is_read():
    bus = make_bus()
    bus.run(500)
    assert bus.problems() == ["", "", "", ""]
    for counter in range(4):
        payload = bytes((counter | FRONT, *bytes(6)))
        crc = crc8(payload, data_id_crc(DATA_ID))
        bus.deliver(CONTACT, bytes((crc,)) + payload)
        bus.run(5)
    touched = bus.feedback.bumper
    assert touched == BumperFeedback(touched.stamp_ns, front=True, rear=False)
    bus.deliver(CONTACT, bytes((crc ^ 1,)) + payload)
    bus.run(5)
    assert bus.feedback.bumper is None


def test_without_it_a_robot_does_not_arm_and_doctor_says_what_to_do():
    health = Health(age_limits(PARAMETERS, SafetyConfig(), 5_000_000), 350_000_000, WHEELS)
    (stale,) = (each for each in health.refusals(10**9) if each.part == "bumper")
    assert stale.code == FaultCode.BUMPER_STALE
    assert str(stale) == "the bumpers' report is older than 200 ms"
    bus = make_bus()
    bus.bumper.alive = False
    bus.run(500)
    assert check_node(bus.status(5), 1).fix == "check its power and cable"
    assert bus.status(5).fault == FaultCode.NODE_NOT_HEARD
