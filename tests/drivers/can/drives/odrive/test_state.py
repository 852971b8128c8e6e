"""What the host asks of an ODrive axis next."""

from __future__ import annotations

from robotctl.drivers.can.drives.odrive.state import DRIVE, ENTER, REST, STOP, WAIT, AxisMachine

MS = 1_000_000
IDLE, CLOSED_LOOP = 1, 8


def idle_machine():
    machine = AxisMachine()
    machine.heard(IDLE)
    assert machine.next(0, enable=False, ready=True) == REST
    return machine


def test_an_axis_is_asked_once_and_driven_when_it_says_that_it_is_there():
    machine = idle_machine()
    assert machine.next(5 * MS, enable=True, ready=True) == ENTER
    assert machine.next(10 * MS, enable=True, ready=True) == WAIT
    machine.heard(CLOSED_LOOP)
    assert machine.next(15 * MS, enable=True, ready=True) == DRIVE


def test_a_lost_request_is_repeated_only_when_a_heartbeat_must_have_come():
    machine = idle_machine()
    assert machine.next(5 * MS, enable=True, ready=True) == ENTER
    asked = [machine.next(now * MS, enable=True, ready=True) for now in range(10, 300, 5)]
    assert asked.index(ENTER) * 5 + 5 == 250
    assert asked.count(ENTER) == 1


def test_an_axis_is_stopped_although_its_last_heartbeat_is_older_than_the_request():
    machine = idle_machine()
    machine.next(5 * MS, enable=True, ready=True)
    # No heartbeat yet: the last one says idle.
    asked = [machine.next(now * MS, enable=False, ready=True) for now in range(10, 255, 5)]
    assert set(asked) == {STOP}
    assert machine.next(260 * MS, enable=False, ready=True) == REST


def test_an_axis_that_has_power_unasked_is_stopped():
    machine = idle_machine()
    machine.heard(CLOSED_LOOP)
    assert not machine.confirmed
    assert machine.next(5 * MS, enable=False, ready=True) == STOP
    assert machine.next(10 * MS, enable=True, ready=False) == STOP


def test_after_a_latch_power_needs_a_command_without_power_first():
    machine = idle_machine()
    machine.next(5 * MS, enable=True, ready=True)
    machine.heard(CLOSED_LOOP)
    assert machine.next(10 * MS, enable=True, ready=False) == STOP
    machine.heard(IDLE)
    assert machine.next(900 * MS, enable=True, ready=True) == REST
    assert machine.next(905 * MS, enable=False, ready=True) == REST
    assert machine.next(910 * MS, enable=True, ready=True) == ENTER


def test_a_refusal_counts_only_for_the_present_request():
    machine = idle_machine()
    assert not machine.is_refusal(5 * MS)
    machine.next(10 * MS, enable=True, ready=True)
    assert not machine.is_refusal(15 * MS)
    assert machine.is_refusal(40 * MS)
    machine.heard(CLOSED_LOOP)
    assert not machine.is_refusal(50 * MS)
