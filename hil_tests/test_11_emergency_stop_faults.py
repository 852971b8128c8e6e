"""The emergency stop from each source, at any moment: it wins, latches, and ends by arming."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

import pytest

from hil_tests.bus_tool import EMCY_DRIVE, EMERGENCY_STOP
from hil_tests.emergency_stop import ON_THE_BUS, SOURCES, assert_latched
from hil_tests.rig import GUEST_TIME, PATIENT_S, UNIT, Rig
from robotctl.app.supervision.stack import CONTROL, NAVIGATION
from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.faults import FaultCode

ON_THE_BUS_MS = 50.0
"""A tick, and as long as a process may be late before the machine counts as standing, twice."""

source = pytest.mark.parametrize("source", list(SOURCES))


# First: it has a bench of its own, and on a real bus there is room for one.
@pytest.mark.skipif(GUEST_TIME == "real", reason="a guest's processor leaves nothing to navigation")
def test_to_all_processes_at_once_whichever_of_them_is_stopped(
    rig: Rig, without_floods: None, reaction: Callable[[str, float], None]
) -> None:
    rig.start_supervised()
    unit = rig.unit()
    rig.prefer(NAVIGATION)
    for stopped in UNIT:
        rig.arm()
        rig.set_mode(Mode.GUIDED)
        rig.guide(0.4, 0.8, 1.0)
        assert rig.control.v_m_s > 0.2, rig.told()
        rig.heard(0.02)
        rig.at_any_moment()
        os.kill(unit[stopped], signal.SIGSTOP)
        asked_s = time.time()
        for pid in unit.values():
            os.kill(pid, signal.SIGUSR1)
        answer = EMCY_DRIVE if stopped == CONTROL else EMERGENCY_STOP
        taken_ms = 1000 * (rig.heard_until(answer, 1.0)[-1].timestamp - asked_s)
        reaction(f"emergency stop by SIGUSR1 to all, {stopped.rpartition('.')[2]} hangs", taken_ms)
        assert taken_ms < (CUT_OFF_MS if stopped == CONTROL else ON_THE_BUS_MS), stopped
        os.kill(unit[stopped], signal.SIGCONT)
        rig.wait_for_state(SafetyState.EMERGENCY_STOP, 2.0)
        rig.wait(lambda: rig.navigation.mode == Mode.HOLD, PATIENT_S, "navigation holds")
        rig.at_rest()
        assert rig.unit() == unit, f"with {stopped} stopped, the signal has ended a process"


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


CUT_OFF_MS = 110.0
"""The drive's time-out, its resolution, and the frames before its EMCY."""
