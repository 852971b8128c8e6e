"""Events of nodes: each is told once, and the drive's restart begins the counts anew."""

from __future__ import annotations

import pytest

from robotctl.messages.control import EmergencyMessage, Feedback, NodeStatus, Severity
from robotctl.messages.faults import FaultCode
from robotctl.safety.node_events import NodeEvents

NAMES = {1: "drive", 2: "sonar", 3: "battery"}


def nodes(**boots: int) -> tuple[NodeStatus, ...]:
    numbers = {name: number for number, name in NAMES.items()}
    return tuple(NodeStatus(numbers[name], name, 5, 0, count, "") for name, count in boots.items())


def test_the_first_boot_of_a_node_is_no_restart() -> None:
    events = NodeEvents(["drive"]).take(Feedback(nodes=nodes(drive=1, sonar=1)), 7)
    assert events is not None
    assert (events.drive_booted, events.restarts, events.notices) == (True, (), ())


@pytest.mark.parametrize("name", NAMES.values())
def test_a_restart_is_told_once_as_a_fault_of_its_node(name: str) -> None:
    known = NodeEvents(["drive"])
    known.take(Feedback(nodes=nodes(drive=1, sonar=1, battery=1)), 1)
    again = Feedback(nodes=nodes(**{**dict.fromkeys(NAMES.values(), 1), name: 2}))
    events = known.take(again, 2)
    assert events is not None
    [fault] = events.restarts
    assert (fault.code, fault.part) == (FaultCode.NODE_RESTARTED, name)
    assert events.drive_booted is (name == "drive")
    assert len(events.notices) == (name == "drive")
    assert known.take(again, 3) is None


def test_where_nothing_is_new_there_are_no_events() -> None:
    known, feedback = NodeEvents(["drive"]), Feedback(nodes=nodes(drive=1))
    assert known.take(feedback, 1) is not None
    assert known.take(feedback, 2) is None


def test_an_error_is_told_once_until_errors_are_forgotten() -> None:
    known, up = NodeEvents(["drive"]), nodes(drive=1)
    known.take(Feedback(nodes=up), 1)
    error = Feedback(nodes=up, emergencies=(EmergencyMessage(2, 1, 0x3220, 5),))

    def texts() -> list[str]:
        events = known.take(error, 5)
        assert events is not None
        assert all(notice.severity == Severity.WARNING for notice in events.notices)
        return [notice.text for notice in events.notices]

    [text] = texts()
    assert text.startswith("drive (node 1) reports error 0x3220")
    assert texts() == []
    known.forget_errors()
    assert texts() == [text]


def test_a_node_without_errors_any_more_says_nothing() -> None:
    known = NodeEvents(["drive"])
    events = known.take(Feedback(emergencies=(EmergencyMessage(2, 1, 0, 0),)), 5)
    assert events is not None
    assert events.notices == ()
