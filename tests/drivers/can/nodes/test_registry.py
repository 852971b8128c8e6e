"""`CAN_NODES` against the DBC and the messages: what an entry says is true of the wire."""

import dataclasses

import msgspec
import pytest

from robotctl.app.processes.robot import make_codec
from robotctl.deploy.doctor_nodes import only_listened
from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import HOST
from robotctl.drivers.can.nodes.registry import CAN_NODES, wanted_nodes
from robotctl.messages.control import Feedback, NodeStatus
from robotctl.safety.drive_health import ACTUATOR_AGES
from robotctl.safety.health import Health
from robotctl.safety.state_machine import SafetyConfig
from tests.native_frames import WHEELS, age_limits

DBC = make_codec().dbc
FIELDS = Feedback.__struct_fields__
BARE = NodeParameters(200, 90, 350, sonars=0)
NAMES = (1, "drive"), (2, "sonar"), (3, "power")
RING = dataclasses.replace(BARE, sonars=8)


def test_numbers_and_names_are_each_nodes_own():
    assert len({node.node_id for node in CAN_NODES}) == len(CAN_NODES)
    assert len({node.name for node in CAN_NODES}) == len(CAN_NODES)


@pytest.mark.parametrize("node", CAN_NODES, ids=lambda node: node.name)
def test_a_node_has_all_its_services_and_frames_in_the_dbc(node):
    sent = {
        message.arbitration_id: name
        for name, message in DBC.messages.items()
        if message.senders == (node.name.upper(),)
    }
    services = {base + node.node_id for base in (0x080, 0x580, 0x700)}
    assert services <= sent.keys()
    protected = {sent[each] for each in sent.keys() - services}
    assert protected == {frame.message for frame in node.frames}
    assert all(HOST in DBC.message(name).receivers for name in protected)


@pytest.mark.parametrize("node", CAN_NODES, ids=lambda node: node.name)
def test_whatever_a_node_reports_has_a_greatest_age(node):
    ages = node.ages(SafetyConfig(), 5_000_000)
    assert len({age.field for age in ages}) == len({frame.field for frame in node.frames})
    assert {age.field for age in ages} <= {*FIELDS, *ACTUATOR_AGES}
    assert all(age.limit_ns > 0 for age in ages)


def test_a_sonar_ring_is_wanted_only_with_sonars():
    assert "sonar" not in [node.name for node in wanted_nodes(BARE)]
    assert "sonar" in [node.name for node in wanted_nodes(RING)]
    assert "sonars" not in [age.field for age in age_limits(BARE, SafetyConfig(), 1)]


def test_doctor_names_who_is_heard_and_who_is_not():
    nodes = [NodeStatus(number, name, 0, 0, boots=0, problem="") for number, name in NAMES]
    heard = [msgspec.structs.replace(node, boots=node.name != "sonar") for node in nodes]
    said = only_listened(tuple(heard)).found
    assert said.endswith("heartbeats of drive, power were heard, not of sonar")
    assert only_listened(tuple(nodes)).found.endswith(
        "heartbeats of no node were heard, not of drive, sonar, power"
    )


def test_a_field_that_health_knows_nothing_of_is_judged_by_its_age():
    """As the one of a node that is new: its entry says all there is to say."""
    plain = age_limits(BARE, SafetyConfig(), 5_000_000)
    other = plain[0]._replace(field="emergency_stop", words="the new node's report is")
    health = Health((*plain, other), 350_000_000, WHEELS)
    assert other.fault() in health.refusals(10**9)
