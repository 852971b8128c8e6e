"""Events: numbered, repeated on request, and put into words by the metadata alone."""

import json
import struct

import pytest
from pymavlink.dialects.v20 import common as m

from robotctl.dialect import additions as d
from robotctl.mavlink.event_kinds import event_metadata
from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.faults import FaultCode


def words(event):
    """Return what a station says of an event, as libevents builds it."""
    component = json.loads(event_metadata(1))["components"][str(event.id >> 24)]
    described = component["event_groups"]["default"]["events"][str(event.id & 0xFFFFFF)]
    text, at = described["message"], 0
    for place, argument in enumerate(described["arguments"], 1):
        enum = component["enums"][argument["type"]]
        form = {"uint8_t": "<B", "uint16_t": "<H"}[enum["type"]]
        (value,) = struct.unpack_from(form, bytes(event.arguments), at)
        at += struct.calcsize(form)
        text = text.replace(f"{{{place}}}", enum["entries"][str(value)]["description"])
    return text


def happen(bench):
    """Let three things happen; return their events."""
    current = d.MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE
    bench.command(m.MAV_CMD_SET_MESSAGE_INTERVAL, current, 1e6)
    bench.step(bench.control(), bench.navigation(mode=Mode.HOLD))
    bench.take()
    bench.step(bench.control(state=SafetyState.ARMED))
    bench.step(bench.control(state=SafetyState.ARMED), bench.navigation(mode=Mode.AUTO))
    fault = {"state": SafetyState.FAULT, "fault": FaultCode.NODE_SILENT}
    bench.step(bench.control(**fault))
    bench.step(bench.control(**fault))
    return bench.messages("EVENT")


def test_events_are_told_once_in_order_and_mean_what_happened(bench):
    events = happen(bench)
    assert [words(each) for each in events] == [
        "State armed",
        "Mode auto",
        "State fault: node silent",
    ]
    first = events[0].sequence
    assert [each.sequence for each in events] == [first, first + 1, first + 2]
    assert [each.log_levels & 0xF for each in events] == [5, 5, 2]


def test_lost_events_are_repeated_and_those_not_kept_are_named(bench):
    events = happen(bench)
    last = events[-1].sequence
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, d.MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE)
    bench.step()
    assert bench.messages("CURRENT_EVENT_SEQUENCE")[-1].sequence == last
    bench.receive(d.MAVLink_request_event_message(1, 1, last - 1, last + 1), system=7)
    bench.step()
    sent = [each for each, _ in bench.take()]
    again = [each for each in sent if each.get_type() == "EVENT"]
    assert [each.to_dict() for each in again] == [each.to_dict() for each in events[1:]]
    (missing,) = [each for each in sent if each.get_type() == "RESPONSE_EVENT_ERROR"]
    assert (missing.sequence, missing.target_system) == (last + 1, 7)
    bench.receive(d.MAVLink_request_event_message(1, 1, 0, 0xFFFF))
    bench.step()
    answers = [e for e, _ in bench.take() if e.get_type() in {"EVENT", "RESPONSE_EVENT_ERROR"}]
    assert len(answers) == 64  # and no more, whatever is asked for


def test_high_latency_is_one_small_message_and_ends_when_asked(bench):
    """As MAVLink describes HIGH_LATENCY2: fifths of m/s, half degrees, percent."""
    bench.step(bench.control(), bench.navigation())
    bench.command(m.MAV_CMD_CONTROL_HIGH_LATENCY, 1)
    bench.run(1.0)
    bench.take()
    bench.run(20.0, v_m_s=0.6, duty=(0.5, 0.3), theta_rad=0.0)
    sent = [each for each, _ in bench.take()]
    assert {each.get_type() for each in sent} <= {"HEARTBEAT", "HIGH_LATENCY2", "STATUSTEXT"}
    small = [each for each in sent if each.get_type() == "HIGH_LATENCY2"]
    assert len(small) in {4, 5}
    now = small[-1]
    assert (now.groundspeed, now.heading, now.throttle, now.battery) == (3, 45, 40, 80)
    assert now.failure_flags == 0
    bench.command(m.MAV_CMD_CONTROL_HIGH_LATENCY, 0)
    bench.run(1.0)
    assert bench.messages("ATTITUDE")


@pytest.mark.parametrize(
    ("changes", "flag"),
    [
        ({"state": SafetyState.FAULT}, m.HL_FAILURE_FLAG_ENGINE),
        ({"state": SafetyState.STANDBY}, 0),
    ],
)
def test_high_latency_says_what_fails(bench, changes, flag):
    bench.step(bench.control(**changes), bench.navigation())
    bench.command(m.MAV_CMD_REQUEST_MESSAGE, m.MAVLINK_MSG_ID_HIGH_LATENCY2)
    bench.step()
    assert bench.messages("HIGH_LATENCY2")[0].failure_flags == flag
