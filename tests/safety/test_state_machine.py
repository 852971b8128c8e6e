"""The table of transitions, read as laws."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.messages.control import SafetyState
from robotctl.messages.faults import Fault, FaultCode
from robotctl.safety.state_machine import (
    ENABLED,
    LATCHED,
    POWERED,
    TRANSITIONS,
    Event,
    SafetyMachine,
)

EVENTS = st.lists(st.sampled_from(list(Event)), max_size=60)


# One row a state, one column an event, in the order below. B boot, S standby, A armed, D driving,
# F fault, X emergency stop.
COLUMNS = [
    "EMERGENCY_STOP",
    "FAULT",
    "DISARM",
    "READY",
    "NOT_READY",
    "ARM",
    "RESET",
    "MOVE",
    "REST",
    "TEST",
    "TEST_OVER",
]
TABLE = {
    "BOOT": "X B B S B B B B B B B",
    "STANDBY": "X S S S B A S S S T S",
    "ARMED": "X F S A A A A D A A A",
    "DRIVING": "X F S D D D D D A D D",
    "FAULT": "X F F F F F S F F F F",
    "EMERGENCY_STOP": "X X X X X X S X X X X",
    "MOTOR_TEST": "X F S T T T T T T T S",
}
LETTER = {"B": "BOOT", "S": "STANDBY", "A": "ARMED", "D": "DRIVING", "F": "FAULT",
          "X": "EMERGENCY_STOP", "T": "MOTOR_TEST"}  # fmt: skip


def test_the_table_names_every_state_and_every_event() -> None:
    assert set(TABLE) == {state.name for state in SafetyState}
    assert [event.name for event in Event] == COLUMNS


@pytest.mark.parametrize("state", TABLE)
@pytest.mark.parametrize("event", COLUMNS)
def test_every_event_in_every_state(state: str, event: str) -> None:
    machine = SafetyMachine()
    machine.state = SafetyState[state]
    expected = LETTER[TABLE[state].split()[COLUMNS.index(event)]]
    assert machine.on(Event[event]) == (expected != state)
    assert machine.state == SafetyState[expected]


def test_a_machine_begins_in_boot_without_power() -> None:
    machine = SafetyMachine()
    assert machine.state is SafetyState.BOOT
    assert machine.powered is False


def test_two_states_are_powered_one_tests_and_two_others_latch() -> None:
    assert {SafetyState.ARMED, SafetyState.DRIVING} == POWERED
    assert {*POWERED, SafetyState.MOTOR_TEST} == ENABLED
    assert {SafetyState.FAULT, SafetyState.EMERGENCY_STOP} == LATCHED


def test_an_emergency_stop_leads_to_its_latch_from_every_state() -> None:
    for state in set(SafetyState) - {SafetyState.EMERGENCY_STOP}:
        assert TRANSITIONS[state, Event.EMERGENCY_STOP] == SafetyState.EMERGENCY_STOP


def test_only_an_accepted_request_leads_from_unpowered_to_powered() -> None:
    entries = {
        (state, event)
        for (state, event), new in TRANSITIONS.items()
        if state not in ENABLED and new in ENABLED
    }
    assert entries == {(SafetyState.STANDBY, Event.ARM), (SafetyState.STANDBY, Event.TEST)}
    assert not any(
        new in POWERED for (state, _), new in TRANSITIONS.items() if state is SafetyState.MOTOR_TEST
    )


@given(EVENTS)
def test_a_latched_state_is_left_only_by_a_request_to_arm(events: list[Event]) -> None:
    machine = SafetyMachine()
    for event in events:
        before = machine.state
        machine.on(event)
        if before in LATCHED and machine.state not in LATCHED:
            assert event == Event.RESET
            assert machine.state not in ENABLED


@given(EVENTS)
def test_after_a_fault_in_motion_the_robot_is_never_powered(events: list[Event]) -> None:
    machine = SafetyMachine()
    for event in events:
        machine.on(event)
        if event in (Event.EMERGENCY_STOP, Event.FAULT, Event.DISARM):
            assert machine.state not in ENABLED


def test_an_event_says_whether_it_changed_the_state_and_keeps_its_reason_only_then() -> None:
    machine = SafetyMachine()
    assert (machine.state, machine.reason) == (SafetyState.BOOT, "starting")
    for event in Event:
        changes = (SafetyState.BOOT, event) in TRANSITIONS
        machine = SafetyMachine()
        assert machine.on(event, "because") is changes
        assert machine.reason == ("because" if changes else "starting")
        assert (machine.state != SafetyState.BOOT) == changes
        machine = SafetyMachine()
        machine.on(event)
        assert machine.reason == ("" if changes else "starting")


def test_a_fault_is_kept_beside_its_text_until_another_reason() -> None:
    machine = SafetyMachine()
    machine.on(Event.READY)
    machine.on(Event.ARM)
    fault = Fault(FaultCode.BUS_DOWN, "the CAN bus is down")
    machine.on(Event.FAULT, fault)
    assert (machine.fault, machine.reason) == (fault, "the CAN bus is down")
    machine.on(Event.FAULT, Fault(FaultCode.BUS_OFF, "later"))
    assert machine.fault == fault
    machine.on(Event.RESET, "arming after a stop")
    assert (machine.fault, machine.reason) == (None, "arming after a stop")


def test_every_state_can_be_reached_and_left() -> None:
    reached = set(TRANSITIONS.values()) | {SafetyState.BOOT}
    left = {state for state, _ in TRANSITIONS}
    assert reached == left == set(SafetyState)
