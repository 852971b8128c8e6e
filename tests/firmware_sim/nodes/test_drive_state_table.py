"""The drive's latch rules: the whole table, written out from the requirements."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.nodes.drive_state import LATCHED, DriveEvent, DriveState, DriveStateMachine

EVENTS = (
    "POWER_UP",
    "WARM_RESET",
    "OPERATIONAL",
    "LEFT_OPERATIONAL",
    "ENABLE",
    "DISABLE",
    "TIMEOUT",
    "FAULT",
    "EMERGENCY_STOP",
    "CLEAR",
)
# One row a state, one column an event, in the order above. B boot, R ready, E enabled, S stopped,
# F fault, X emergency stop.
TABLE = {
    "BOOT": "B B R B B B B F X B",
    "READY": "B B R R E R R F X R",
    "ENABLED": "B B E R E R S F X E",
    "STOPPED": "B S S S S S S F X R",
    "FAULT": "B F F F F F F F X R",
    "EMERGENCY_STOP": "B X X X X X X X X R",
}
LETTER = {"B": "BOOT", "R": "READY", "E": "ENABLED", "S": "STOPPED", "F": "FAULT",
          "X": "EMERGENCY_STOP"}  # fmt: skip
PATH = {
    "BOOT": [],
    "READY": ["OPERATIONAL"],
    "ENABLED": ["OPERATIONAL", "ENABLE"],
    "STOPPED": ["OPERATIONAL", "ENABLE", "TIMEOUT"],
    "FAULT": ["FAULT"],
    "EMERGENCY_STOP": ["EMERGENCY_STOP"],
}


def machine_in(state):
    machine = DriveStateMachine()
    for event in PATH[state]:
        machine.handle(DriveEvent[event])
    assert machine.state is DriveState[state]
    return machine


def test_the_table_is_complete():
    # In the order of their numbers on the wire.
    assert [(state.name, state.value) for state in DriveState] == [
        (name, number) for number, name in enumerate(TABLE)
    ]
    assert set(EVENTS) == {event.name for event in DriveEvent}


@pytest.mark.parametrize("state", TABLE)
@pytest.mark.parametrize("event", EVENTS)
def test_every_event_in_every_state(state, event):
    machine = machine_in(state)
    expected = LETTER[TABLE[state].split()[EVENTS.index(event)]]
    changed = machine.handle(DriveEvent[event])
    assert machine.state.name == expected
    assert changed is (expected != state)


@pytest.mark.parametrize("state", ["STOPPED", "FAULT", "EMERGENCY_STOP"])
def test_after_a_latched_state_enable_needs_a_disable_first(state):
    machine = machine_in(state)
    machine.handle(DriveEvent.DISABLE)
    machine.handle(DriveEvent.CLEAR)
    machine.handle(DriveEvent.ENABLE)
    assert machine.state is DriveState.READY
    machine.handle(DriveEvent.DISABLE)
    machine.handle(DriveEvent.ENABLE)
    assert machine.state is DriveState.ENABLED


@pytest.mark.parametrize("event", ["LEFT_OPERATIONAL", "WARM_RESET"])
def test_driving_that_nmt_ended_needs_a_disable_before_it_goes_on(event):
    machine = machine_in("ENABLED")
    machine.handle(DriveEvent[event])
    machine.handle(DriveEvent.OPERATIONAL)
    machine.handle(DriveEvent.ENABLE)
    assert machine.state is DriveState.READY
    machine.handle(DriveEvent.DISABLE)
    machine.handle(DriveEvent.ENABLE)
    assert machine.state is DriveState.ENABLED


@pytest.mark.parametrize("state", ["STOPPED", "FAULT", "EMERGENCY_STOP"])
def test_power_up_forgets_that_a_disable_was_needed(state):
    machine = machine_in(state)
    machine.handle(DriveEvent.CLEAR)
    assert machine.locked is True
    assert machine.handle(DriveEvent.ENABLE) is False
    machine.handle(DriveEvent.POWER_UP)
    assert machine.locked is False
    machine.handle(DriveEvent.OPERATIONAL)
    assert machine.handle(DriveEvent.ENABLE) is True


def test_the_host_may_disable_and_enable_as_it_likes():
    machine = machine_in("ENABLED")
    for _ in range(3):
        assert machine.handle(DriveEvent.DISABLE) is True
        assert machine.locked is False
        assert machine.handle(DriveEvent.ENABLE) is True


def test_a_new_drive_is_not_locked():
    assert DriveStateMachine().locked is False


@given(events=st.lists(st.sampled_from(DriveEvent), max_size=40))
def test_no_history_leaves_a_latch_but_clear_and_power(events):
    machine = DriveStateMachine()
    for event in events:
        before = machine.state
        machine.handle(event)
        if before in LATCHED and machine.state not in LATCHED:
            assert event in {DriveEvent.CLEAR, DriveEvent.POWER_UP}


@given(events=st.lists(st.sampled_from(DriveEvent), max_size=40))
def test_no_history_drives_without_a_disable_since_the_last_unasked_stop(events):
    machine = DriveStateMachine()
    stopped = False
    for event in events:
        before = machine.state
        machine.handle(event)
        now = machine.state
        unasked = before is DriveState.ENABLED and event is not DriveEvent.DISABLE
        if event is DriveEvent.POWER_UP:
            stopped = False
        elif now in LATCHED or (unasked and now is not before):
            stopped = True
        elif event is DriveEvent.DISABLE:
            stopped = False
        assert not (stopped and now is DriveState.ENABLED)
