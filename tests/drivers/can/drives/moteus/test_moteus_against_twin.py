"""The host's moteus drives its twin on the simulated bus with CAN FD: two wheels."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.moteus.config import MoteusMotor as TwinMotor
from firmware_sim.drives.moteus.settings import MoteusSettings
from firmware_sim.plant.axis import Mode
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.config import MoteusMotor
from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import FaultCode
from tests.drivers.can.drives.bench import BRAKE, COAST, MS, NEEDS, PERIOD_NS, TICKS, Bench, on

RATIO = 20.0


def bench(
    settings: dict | None = None,
    *,
    reverse: bool = False,
    host: dict | None = None,
    true: dict | None = None,
) -> Bench:
    """Return a robot with a moteus on each of two wheels, the second one as it should be."""
    tables = []
    for number, wheel, turned in ((1, "left", reverse), (10, "right", False)):
        axis = (wheel, 1, turned, RATIO)
        first = number == 1
        options = (host or {}) if first else {}
        tables.append(
            (
                MoteusMotor(
                    "moteus", wheel, (AxisConfig(*axis),), **{"node_id": number, **options}
                ),
                TwinMotor(
                    "moteus",
                    wheel,
                    (AxisSection(*axis),),
                    **{"node_id": number, **((true or {}) if first else {})},
                ),
                MoteusSettings(**{"max_current_a": 10.0, **((settings or {}) if first else {})}),
            )
        )
    return Bench(*tables, data_bitrate=5_000_000)


@pytest.fixture(params=[False, True], ids=["answers before", "answers after"])
def robot(request) -> Bench:
    made = bench({"answers_after": request.param})
    made.commission()
    made.run(0.05)
    return made


def drive(robot: Bench, speed: float = 4.0, seconds: float = 0.5) -> None:
    robot.run(seconds, on(speed))


def test_they_come_into_service_and_their_setting_is_written_and_read_back(robot):
    status = [(each.status.node_id, each.status.nmt_state, each.status.boots) for each in
              robot.drives]  # fmt: skip
    assert status == [(1, 5, 1), (10, 5, 1)]
    assert [twin.timeout_mode for twin in robot.twins] == [15, 15]
    assert robot.drive.proof == "time-out 90 ms with each command, then it shorts the motor"
    assert robot.state is DriveState.READY
    assert not robot.powered


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("speed", [5.0, -5.0])
def test_a_wheel_has_its_speed_and_tells_it_in_its_own_sense(reverse, speed):
    robot = bench(reverse=reverse)
    robot.commission()
    robot.run(0.05)
    begin, start = robot.report.position_ticks, robot.turns()
    drive(robot, speed, 1.5)
    report = robot.report
    assert report.state is DriveState.ENABLED
    assert robot.speed() == pytest.approx(speed, abs=0.05)
    assert report.speed_rad_s == pytest.approx(speed, abs=0.05)
    moved = (report.position_ticks - begin) / TICKS
    assert moved == pytest.approx(robot.turns() - start, abs=0.01)
    assert math.copysign(1.0, report.current_a) == math.copysign(1.0, speed)
    assert report.voltage_v == pytest.approx(robot.plant.bus_voltage_v, abs=0.1)
    assert report.temperature_c == pytest.approx(30.0)
    assert report.motion_ns == report.report_ns == report.supply_ns > robot.now_ns - PERIOD_NS
    robot.run(0.8, BRAKE)
    assert abs(robot.speed()) < 0.05
    assert robot.state is DriveState.READY


def test_two_wheels_have_speeds_of_their_own(robot):
    robot.run(1.0, on(3.0), on(-3.0))
    assert robot.speed(0) == pytest.approx(3.0, abs=0.05)
    assert robot.speed(1) == pytest.approx(-3.0, abs=0.05)


def test_without_power_a_wheel_coasts_or_brakes_as_commanded(robot):
    speeds = []
    for command, mode in ((COAST, Mode.COAST), (BRAKE, Mode.SHORTED)):
        drive(robot, 8.0, 1.0)
        robot.run(0.1, command)
        assert robot.plant.axes[0].mode is mode
        speeds.append(robot.speed())
    assert speeds[1] < speeds[0] - 1.0


def test_enabled_is_told_only_when_the_drive_is_in_position_mode():
    robot = bench({"preparing_ms": 40})
    robot.commission()
    robot.run(0.05)
    told = []
    for _ in range(20):
        robot.tick(on(3.0))
        assert (robot.state is DriveState.ENABLED) <= (robot.twin.mode == 10)
        told.append(robot.state)
    assert told[-1] is DriveState.ENABLED
    assert told[5] is DriveState.READY


def test_a_silent_host_leaves_no_power_after_the_time_out():
    rng = np.random.default_rng(7)
    robot = bench()
    robot.commission()
    for _ in range(100):
        robot.run(0.05)
        robot.run(float(rng.uniform(0.05, 0.3)), on(float(rng.uniform(-8.0, 8.0))))
        last_ns = robot.now_ns
        robot.advance(int(rng.integers(0, PERIOD_NS)))
        while robot.powered:
            robot.advance(MS)
            assert robot.now_ns - last_ns <= NEEDS.command_timeout_ms * MS + PERIOD_NS
        robot.clear()
        robot.run(0.05)


@pytest.mark.parametrize(("coasts", "mode"), [(False, Mode.SHORTED), (True, Mode.COAST)])
def test_after_the_time_out_it_brakes_or_coasts_and_stays_so(coasts, mode):
    robot = bench(host={"accept_coasting": coasts})
    robot.commission()
    robot.run(0.05)
    drive(robot, 8.0, 0.5)
    robot.advance(200 * MS)
    assert robot.twin.mode == 11
    assert robot.plant.axes[0].mode is mode
    robot.send(wire.command_id(1), wire.pack_velocity(10.0, 0.09))
    robot.advance(20 * MS)
    assert robot.twin.mode == 11, "the drive latches"


def test_a_host_that_was_held_up_does_not_drive_on_by_itself(robot):
    drive(robot)
    robot.advance(120 * MS)
    robot.run(0.5, on(4.0))
    assert robot.report.fault.code is FaultCode.DRIVE_COMMAND_TIMEOUT
    assert abs(robot.speed()) < 0.5
    robot.clear()
    robot.run(0.3, on(4.0))
    assert robot.state is DriveState.READY, "a disabled command must come first"
    robot.run(0.05)
    drive(robot, 4.0, 1.0)
    assert robot.speed() == pytest.approx(4.0, abs=0.1)


def test_a_time_out_that_the_drive_reports_is_told_as_such(robot):
    drive(robot)
    robot.twin._on_write = lambda written, now_ns: None
    drive(robot, 4.0, 0.2)
    assert robot.state is DriveState.STOPPED
    assert "mode 11" in robot.report.fault.text
    assert robot.report.fault.code is FaultCode.DRIVE_COMMAND_TIMEOUT


CODES = {
    34: FaultCode.DRIVE_OVER_VOLTAGE,
    35: FaultCode.DRIVE_ENCODER,
    36: FaultCode.DRIVE_PARAMETER,
    38: FaultCode.DRIVE_OVER_TEMPERATURE,
    40: FaultCode.DRIVE_UNDER_VOLTAGE,
    44: FaultCode.DRIVE_FAULT,
    77: FaultCode.DRIVE_FAULT,
}


@pytest.mark.parametrize("code", [*range(32, 49), 77])
def test_a_fault_stops_and_stays_until_it_is_cleared(robot, code):
    drive(robot, 3.0, 0.2)
    robot.twin.trip(code)
    drive(robot, 3.0, 0.02)
    fault = robot.report.fault
    assert robot.state is DriveState.FAULT
    assert f"fault {code}: " in fault.text
    assert fault.part == "left"
    assert fault.code is CODES.get(code, fault.code)
    robot.run(0.3, on(3.0))
    robot.run(0.3)
    assert robot.twin.mode == 1, "nobody has cleared it"
    robot.clear()
    robot.run(0.05)
    assert robot.state is DriveState.READY
    assert robot.twin.mode == 0
    drive(robot, 3.0, 0.3)
    assert robot.state is DriveState.ENABLED


def test_a_fault_that_clears_itself_still_stops(robot):
    drive(robot, 3.0, 0.2)
    robot.twin.trip(40)
    drive(robot, 3.0, 0.02)
    robot.twin.command("d stop")
    drive(robot, 3.0, 0.3)
    assert robot.state is DriveState.FAULT
    assert not robot.plant.axes[0].powered


def test_a_drive_that_somebody_else_stops_stays_stopped(robot):
    drive(robot, 3.0, 0.2)
    robot.twin.command("d stop")
    drive(robot, 3.0, 0.3)
    if robot.twin._settings.answers_after:
        # It obeyed the next command before it said that it had stopped.
        assert robot.state in (DriveState.STOPPED, DriveState.ENABLED)
        return
    assert robot.state is DriveState.STOPPED
    assert "left position mode by itself: it is in mode" in robot.report.fault.text
    assert not robot.plant.axes[0].powered


def test_an_emergency_stop_takes_the_power_at_once_until_faults_are_cleared(robot):
    drive(robot, 6.0, 0.5)
    robot.stop()
    robot.advance(2 * MS)
    assert not robot.powered
    robot.run(0.3, on(6.0))
    assert robot.state is DriveState.EMERGENCY_STOP
    assert not robot.powered
    robot.clear()
    robot.run(0.1, on(6.0))
    assert not robot.powered
    robot.run(0.05)
    drive(robot, 6.0, 0.1)
    assert robot.powered


@pytest.mark.parametrize("boot_ms", [0, 30, 100])
def test_a_drive_that_reboots_while_driving_does_not_drive_on(boot_ms):
    robot = bench({"boot_ms": boot_ms})
    robot.commission()
    robot.run(1.2)  # the counter is to be well above 0
    drive(robot, 6.0, 0.5)
    robot.twin.reboot(robot.now_ns)
    robot.run(0.2, on(6.0))
    assert robot.drive.status.boots == 2
    robot.run(2.0, on(6.0))
    assert robot.drive.status.problem == "", "it is set anew"
    assert robot.twin.timeout_mode == 15
    assert robot.state is not DriveState.ENABLED
    assert not robot.plant.axes[0].powered


def test_a_drive_that_is_gone_is_told_and_comes_back_disabled(robot):
    drive(robot)
    robot.twin._awake_ns = robot.now_ns + 1000 * MS
    robot.run(0.5, on(4.0))
    status = robot.drive.status
    assert (status.fault, status.nmt_state) == (FaultCode.NODE_SILENT, 0)
    assert status.problem == "left (node 1): nothing heard for 350 ms"
    robot.run(2.0, on(4.0))
    assert robot.drive.status.boots == 2
    assert robot.drive.status.problem == ""
    assert robot.state is not DriveState.ENABLED
    assert not robot.plant.axes[0].powered


def test_a_setting_changed_while_driving_takes_it_out_of_service(robot):
    drive(robot)
    robot.twin.command("conf set servo.timeout_mode 12")
    for _ in range(400):
        robot.tick(on(4.0))
        status = robot.drive.status
        if status.problem:
            break
    assert status.fault is FaultCode.NODE_CHANGED
    assert status.problem == (
        "left (node 1): servo.timeout_mode reads 12, wanted 15: it was changed"
    )
    drive(robot, 4.0, 0.02)
    assert not robot.plant.axes[0].powered


@pytest.mark.parametrize(
    ("settings", "true", "code", "words"),
    [
        (
            {"register_map": 4},
            {},
            FaultCode.NODE_OTHER_FIRMWARE,
            "register map 4 of firmware 0x000109 is not known, allowed is 5",
        ),
        ({}, {"node_id": 3}, FaultCode.NODE_NOT_HEARD, "not heard on the bus"),
    ],
)
def test_a_drive_that_is_not_as_it_must_be_stays_out_of_service(settings, true, code, words):
    robot = bench(settings, true=true)
    robot.run(2.0)
    assert robot.drive.status.fault is code
    assert words in robot.drive.status.problem
    robot.run(0.2, on(3.0))
    assert not robot.plant.axes[0].powered
    assert robot.drive.proof is None
    assert robot.drives[1].status.problem == ""


def test_a_setting_that_the_drive_refuses_is_told():
    robot = bench()
    said = robot.twin.command
    robot.twin.command = lambda line: "ERR" if "set" in line else said(line)
    robot.run(2.0)
    assert robot.drive.status.fault is FaultCode.NODE_OTHER_VALUE
    assert "servo.timeout_mode reads back 12, wanted 15" in robot.drive.status.problem


def answer(position=1.0, velocity=0.0, mode=10, counter=0) -> bytes:
    return wire.padded(
        bytes((0x21, 0x00, mode, 0x2E, 0x01))
        + struct.pack("<ff", position, velocity)
        + bytes.fromhex("2504 0000 270d f000 2c01 0000 2970")
        + struct.pack("<I", counter)
    )


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (answer(position=math.nan), "its position is nan turns"),
        (answer(velocity=math.inf), "velocity is inf turns/s"),
        (answer()[:24], "an answer of 24 bytes (21 00 0a"),
        (b"\x31\x70\x01", "an answer of 3 bytes (31 70 01)"),
        (b"", "an answer of 0 bytes"),
    ],
)
def test_what_is_not_documented_stops_the_drive_and_is_quoted(robot, data, words):
    drive(robot, 3.0, 0.2)
    counter = robot.drive._state._counter
    robot.deliver(wire.answer_ids(1)[0], data.replace(bytes(4), struct.pack("<I", counter), 0))
    robot.drive._state._counter = -1
    robot.tick(on(3.0))
    assert robot.state is DriveState.FAULT
    assert robot.report.fault.code is FaultCode.DRIVE_UNREADABLE
    assert words in robot.report.fault.text
    robot.run(0.1, on(3.0))
    assert not robot.plant.axes[0].powered


def test_a_position_of_a_drive_in_a_fault_may_be_no_number(robot):
    robot.deliver(wire.answer_ids(1)[0], answer(position=math.nan, mode=1))
    robot.drive._state._counter = -1
    robot.tick(COAST)
    assert robot.report.fault.code is FaultCode.DRIVE_FAULT
    assert math.isfinite(robot.report.position_ticks)


def test_a_counter_that_stands_still_stops_the_drive(robot):
    drive(robot, 3.0, 0.2)
    counter = robot.drive._state._counter
    robot.twin._registers[0x070] = lambda: counter
    drive(robot, 3.0, 0.2)
    assert robot.state is DriveState.FAULT
    assert f"stands at {counter} for 1" in robot.report.fault.text


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e9])
def test_what_the_wire_cannot_carry_is_no_power(robot, value):
    drive(robot, 3.0, 0.3)
    before = NEEDS.notes.refused
    robot.run(0.1, on(value))
    assert not robot.powered
    assert NEEDS.notes.refused == before + 40


def test_a_speed_beyond_the_drive_saturates_and_the_truth_is_told():
    robot = bench({"max_velocity": 5.0 * RATIO / math.tau})
    robot.commission()
    robot.run(0.05)
    drive(robot, 9.0, 1.0)
    assert robot.speed() == pytest.approx(5.0, abs=0.05)
    assert robot.report.speed_rad_s == pytest.approx(5.0, abs=0.05)


def test_an_answer_of_an_old_session_is_not_taken_for_a_new_one(robot):
    """A line that was asked for before is drained before the setting is read."""
    robot.twin._said = b"12\r\n"
    robot.drive._session.restart()
    robot.commission()
    assert robot.drive.proof is not None


def test_reports_stay_the_same_object_while_nothing_comes(robot):
    before = robot.drive.reports
    robot.drive.check(robot.now_ns)
    assert robot.drive.reports is before
