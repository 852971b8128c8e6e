"""The emergency stop from each source, at any moment: it wins, latches, and ends by arming."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from hil_tests.emergency_stop import ON_THE_BUS, SOURCES, assert_latched
from hil_tests.rig import EMERGENCY_STOP, Rig
from robotctl.messages.control import SafetyState
from robotctl.messages.faults import FaultCode

ON_THE_BUS_MS = 50.0
"""A tick, and as long as a process may be late before the machine counts as standing, twice."""

source = pytest.mark.parametrize("source", list(SOURCES))


@source
def test_while_driving(lasting: Rig, source: str, reaction: Callable[[str, float], None]) -> None:
    lasting.drive(0.4, 0.8, 1.0)
    lasting.heard(0.05)
    lasting.at_any_moment()
    asked_s = time.time()
    SOURCES[source](lasting)
    if source != ON_THE_BUS:
        heard_s = lasting.heard_until(EMERGENCY_STOP, 1.0)[-1].timestamp
        taken_ms = 1000 * (heard_s - asked_s)
        reaction(f"emergency stop by {source}: on the bus", taken_ms)
        assert taken_ms < ON_THE_BUS_MS
    state = lasting.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    assert state.fault in (FaultCode.EMERGENCY_STOP, FaultCode.EMERGENCY_STOP_BUS), state.reason
    assert_latched(lasting)


@source
def test_twice(lasting: Rig, source: str) -> None:
    lasting.drive(0.4, 0.8, 0.5)
    for _ in range(2):
        lasting.heard(0.05)
        SOURCES[source](lasting)
        if source != ON_THE_BUS:
            lasting.heard_until(EMERGENCY_STOP, 1.0)
        lasting.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    assert_latched(lasting)


@source
def test_right_behind_a_request_to_arm(lasting: Rig, source: str) -> None:
    SOURCES[source](lasting)
    lasting.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    number = lasting.ask_to_arm()
    SOURCES[source](lasting)
    lasting.wait_for_state(SafetyState.EMERGENCY_STOP, 1.0)
    lasting.heard(1.5)  # longer than a request to arm may wait
    lasting.listen()
    assert lasting.control.state == SafetyState.EMERGENCY_STOP
    assert number in lasting.acks, "it was not asked to arm"
    assert_latched(lasting)
