"""Power switch of CiA 402: control words for the states that a drive reports."""

from canopen.profiles.p402 import State402

from robotctl.drivers.can.drives.cia402 import wire
from robotctl.drivers.can.drives.cia402.state import PowerSwitch


def test_a_quick_stop_that_makes_a_wheel_faster_takes_the_power_at_once():
    switch = PowerSwitch("drive", 0, 100)
    switch.wants(False, True)
    switch.observe(wire.OPERATION_ENABLED)
    assert switch.wants(True, True)
    switch.word(True)
    switch.wants(False, True)
    braked = [switch.word(True, speed) for speed in (4.0, 4.9, 3.0, 4.9)]
    assert braked == [State402.CW_QUICK_STOP] * 4
    assert switch.word(True, 5.1) == State402.CW_DISABLE_VOLTAGE
    assert switch.word(True, 0.0) == State402.CW_DISABLE_VOLTAGE


def test_it_says_again_and_again_that_no_axis_may_be_enabled_while_there_is_to_be_no_power():
    switch = PowerSwitch("drive", 0, 100)
    switch.observe(wire.OPERATION_ENABLED)
    ticks = []
    for tick in range(1, 61):
        switch.wants(False, True)
        switch.word(True)
        ticks += [tick] if switch.must_rest else []
    assert ticks == [20, 40, 60]
    for _ in range(60):
        assert switch.wants(True, True)
        switch.word(True)
        assert not switch.must_rest
