"""The host's side of an ODrive against its twin, on a simulated bus and a robot that drives."""

from __future__ import annotations

import math
import random

import pytest

from firmware_sim.plant.axis import Mode
from robotctl.messages.actuators import ActuatorCommand, DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import FaultCode
from tests.drivers.can.drives.odrive.rig import MS, NEEDS, NEW, OLD, TICK_NS, TICKS_PER_TURN, Rig

BOTH = pytest.mark.parametrize("firmware", [OLD, NEW], ids=["0.5.6", "0.6.10"])
ANY = [
    OLD,
    NEW,
    {**NEW, "watchdog_fed_by": "any"},
    {**NEW, "watchdog_while_idle": False},
    {**NEW, "heartbeat_on_change": True},
    {**NEW, "pads_sdo": True, "arming_ms": 20.0},
    {"firmware": (0, 6, 11), "hardware": (4, 4, 58), "watchdog_ms": 90.0},
]
"""All that the documents leave open, both ways."""


def powered(rig):
    return [axis.mode is not Mode.COAST for axis in rig.plant.axes]


def speeds(rig):
    return [axis.speed_rad_s for axis in rig.plant.axes]


@pytest.mark.parametrize("settings", ANY)
def test_wheels_follow_speeds_of_either_sign_and_stop(settings):
    rig = Rig(**settings).start()
    for wanted in ((4.0, 4.0), (-3.0, 3.0), (2.0, -2.0)):
        rig.enable(*wanted)
        rig.run(600)
        assert speeds(rig) == pytest.approx(wanted, abs=0.15)
        assert [rig.report(k).speed_rad_s for k in (0, 1)] == pytest.approx(wanted, abs=0.2)
    rig.stop()
    rig.run(300)
    assert powered(rig) == [False, False]
    assert rig.states == [DriveState.READY] * 2
    assert rig.faults == [None, None]


@BOTH
def test_position_current_voltage_and_temperature_are_those_of_the_wheel(firmware):
    rig = Rig(motor_thermistor=True, **firmware).start()
    before = [rig.report(k).position_ticks for k in (0, 1)]
    angles = [axis.angle_rad for axis in rig.plant.axes]
    rig.enable(5.0, -5.0)
    rig.run(1000)
    for place in (0, 1):
        report, axis = rig.report(place), rig.plant.axes[place]
        turned = (axis.angle_rad - angles[place]) / (2 * math.pi) * TICKS_PER_TURN
        # The estimate is up to a tick old, in which the wheel turns by 10 of its ticks.
        assert report.position_ticks - before[place] == pytest.approx(turned, abs=12)
        assert report.voltage_v == pytest.approx(rig.plant.bus_voltage_v, abs=0.3)
        assert report.current_a == pytest.approx(axis.current_a, abs=0.5)
        assert math.copysign(1, report.current_a) == (1, -1)[place]
        if firmware is OLD:
            assert report.temperature_c is None
        else:
            assert report.temperature_c == pytest.approx(max(35.0, axis.temperature_c), abs=0.5)
        assert rig.now_ns - report.motion_ns < 2 * TICK_NS
        assert rig.now_ns - report.supply_ns < 40 * MS


@BOTH
def test_a_drive_is_enabled_only_when_it_says_so_and_gets_no_speed_before(firmware):
    rig = Rig(**firmware).start()
    rig.drive(4.0)
    while rig.states != [DriveState.ENABLED] * 2:
        assert max(map(abs, speeds(rig))) < 0.05
        rig.tick()
    rig.run(300)
    assert min(speeds(rig)) > 3.5


def test_a_speed_beyond_what_the_drive_allows_saturates_and_is_reported_as_it_is():
    rig = Rig(vel_limit=0.5).start().enable(6.0, 6.0)
    rig.run(800)
    assert speeds(rig)[0] == pytest.approx(math.pi, abs=0.2)
    assert rig.report(0).speed_rad_s == pytest.approx(math.pi, abs=0.2)
    assert rig.faults == [None, None]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e39])
def test_a_speed_that_no_frame_carries_gives_no_power(value):
    rig = Rig().start().enable(3.0)
    rig.commands[0] = ActuatorCommand(enable=True, values=(value,))
    refused = NEEDS.notes.refused
    rig.run(20)
    assert powered(rig) == [False, True]
    assert NEEDS.notes.refused == refused + 4


@pytest.mark.parametrize("settings", ANY)
def test_a_silent_host_leaves_no_power_after_the_time_out(settings):
    rig = Rig(**settings).start()
    for seed in range(15):
        random_ = random.Random(seed)
        rig.stop()
        rig.run(700)  # commissioned again, if it was lost
        for drive in rig.drives:
            drive.clear_faults()
        rig.run(random_.randrange(150, 400, 5))
        assert rig.faults == [None, None]
        rig.drive(random_.uniform(-5, 5), random_.uniform(-5, 5))
        rig.run(random_.randrange(5, 800, 5))
        rig.silent = True
        rig.run(NEEDS.command_timeout_ms + 5)
        assert powered(rig) == [False, False]
        rig.run(random_.randrange(0, 300, 5))
        assert powered(rig) == [False, False]
        rig.silent = False
        rig.run(200)
        # Nothing resumes by itself, although the command still allows power.
        assert powered(rig) == [False, False]


def test_without_a_watchdog_the_wheels_run_on_so_that_the_proof_of_0_5_fails():
    rig = Rig(firmware=(0, 5, 6)).start().enable(3.0)
    rig.silent = True
    rig.run(1000)
    assert powered(rig) == [True, True]


@BOTH
@pytest.mark.parametrize("boot_ms", [10.0, 200.0, 1000.0])
def test_a_reboot_while_driving_stops_for_good(firmware, boot_ms):
    rig = Rig(boot_ms=boot_ms, **firmware)
    rig.run(1200)
    rig.start().enable(3.0)
    rig.run(200)
    boots = rig.drives[0].status.boots
    rig.twins[0].power_cycle(rig.bus.now_ns)
    rig.run(400)
    assert powered(rig)[0] is False
    assert rig.report(0).fault is not None
    rig.run(2500)
    assert rig.drives[0].status.boots > boots
    assert rig.drives[0].status.problem == ""
    assert powered(rig)[0] is False
    # Cleared, it still waits for a command without power.
    rig.drives[0].clear_faults()
    rig.run(400)
    assert rig.faults[0] is None
    assert powered(rig)[0] is False
    rig.stop()
    rig.run(50)
    rig.enable(3.0)


@BOTH
def test_a_lost_drive_is_named_and_stays_out(firmware):
    rig = Rig(**firmware).start().enable(3.0)
    rig.twins[0].connect(None, lambda *_: None)
    rig.run(500)
    status = rig.drives[0].status
    assert (status.fault, status.nmt_state) == (FaultCode.NODE_SILENT, 0)
    assert status.problem == "left (node 33): no heartbeat for 350 ms"
    assert rig.drives[0].proof is None
    assert rig.states[0] is DriveState.STOPPED


@BOTH
def test_an_emergency_stop_takes_the_power_and_stays_until_cleared(firmware):
    rig = Rig(**firmware).start().enable(3.0)
    assert rig.drives[0].emergency_stop(rig.send, EmergencyStopSource.OPERATOR)
    rig.tick()
    assert powered(rig)[0] is False
    rig.run(300)
    assert rig.states[0] is DriveState.EMERGENCY_STOP
    assert rig.faults[0].code is FaultCode.DRIVE_EMERGENCY_STOP
    rig.drives[0].clear_faults()
    rig.run(300)
    assert rig.faults[0] is None
    assert powered(rig)[0] is False


@BOTH
def test_an_emergency_stop_of_another_device_is_told_as_one(firmware):
    rig = Rig(**firmware).start().enable(3.0)
    rig.bus.attach("button", lambda _: None).send(33 << 5 | 0x02)
    rig.run(200)
    assert powered(rig)[0] is False
    assert rig.states[0] is DriveState.EMERGENCY_STOP
    assert rig.faults[0].code is FaultCode.DRIVE_EMERGENCY_STOP
    assert "ESTOP_REQUESTED" in str(rig.faults[0])


@BOTH
def test_a_fault_that_goes_by_itself_still_stops_until_cleared(firmware):
    rig = Rig(**firmware).start().enable(3.0)
    rig.twins[0].trip(0x1000, "motor")
    rig.run(100)
    rig.twins[0].errors.heal()
    rig.run(500)
    assert rig.faults[0].code is FaultCode.DRIVE_OVER_CURRENT
    assert powered(rig)[0] is False
    rig.drives[0].clear_faults()
    rig.run(200)
    assert rig.faults[0] is None
    rig.run(500)
    assert powered(rig)[0] is False


@BOTH
def test_a_fault_whose_cause_lasts_is_not_cleared(firmware):
    rig = Rig(**firmware).start().enable(3.0)
    rig.twins[0].trip(0x1000, "motor", lasts=True)
    rig.run(100)
    for _ in range(3):
        rig.drives[0].clear_faults()
        rig.run(300)
        assert rig.states[0] is DriveState.FAULT
    rig.twins[0].errors.heal()
    rig.drives[0].clear_faults()
    rig.run(300)
    assert rig.faults[0] is None


def test_a_drive_that_is_not_calibrated_says_so():
    rig = Rig(calibrated=False).start()
    rig.drive(3.0)
    rig.run(300)
    assert "NOT_CALIBRATED" in str(rig.faults[0])
    old = Rig(calibrated=False, **OLD).start()
    old.drive(3.0)
    old.run(300)
    assert old.faults[0].code is FaultCode.DRIVE_PARAMETER
    assert "axis INVALID_STATE" in str(old.faults[0])


def test_another_device_that_asks_for_idle_is_noticed():
    rig = Rig().start().enable(3.0)
    stranger = rig.bus.attach("stranger", lambda _: None)
    stranger.send(33 << 5 | 0x07, b"\1\0\0\0")
    rig.run(150)
    assert rig.faults[0].code is FaultCode.DRIVE_STOPPED
    assert "another device" in str(rig.faults[0])
    assert powered(rig)[0] is False


@BOTH
def test_a_high_supply_is_told_with_what_to_do_about_it(firmware):
    rig = Rig(overvoltage_v=9.0, undervoltage_v=0.0, **firmware).start()
    rig.drive(3.0)
    rig.run(300)
    assert powered(rig) == [False, False]
    assert "brake resistor" in str(rig.faults[0])
    if firmware is NEW:
        assert rig.faults[0].code is FaultCode.DRIVE_OVER_VOLTAGE


def test_a_node_that_is_not_there_gets_no_frames():
    rig = Rig(boot_ms=5000.0)
    rig.run(1000)
    assert rig.sent == []
    assert rig.drives[0].status.fault is FaultCode.NODE_NOT_HEARD
