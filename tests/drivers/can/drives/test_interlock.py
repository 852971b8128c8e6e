"""Latches that the host keeps for a drive."""

from __future__ import annotations

from robotctl.drivers.can.drives.interlock import Interlock
from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import Fault, FaultCode


def test_the_first_cause_of_a_latch_stays_but_an_emergency_stop_is_told():
    lock = Interlock()
    first, second = (Fault(FaultCode.DRIVE_FAULT, text) for text in ("first", "second"))
    lock.latch(DriveState.FAULT, first)
    lock.latch(DriveState.STOPPED, second)
    assert (lock.state, lock.fault) == (DriveState.FAULT, first)
    lock.latch(DriveState.EMERGENCY_STOP, second)
    assert lock.state is DriveState.EMERGENCY_STOP


def test_power_needs_a_disabled_command_first():
    lock = Interlock()
    assert not lock.admits(True, True), "none has been disabled yet"
    assert not lock.admits(False, True)
    assert lock.admits(True, True)
    lock.latch(DriveState.FAULT)
    assert not lock.admits(True, True)
    lock.clear()
    assert not lock.admits(True, True)
    lock.admits(False, True)
    assert lock.admits(True, True)
    assert not lock.admits(True, False)
    assert not lock.admits(True, True), "it was out of service in between"
    lock.admits(False, True)
    lock.withhold()
    assert not lock.admits(True, True)
