"""The host's VESC drives its twin on the simulated bus: a car with a motor and a servo."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from firmware_sim.drives.config import AxisSection
from firmware_sim.drives.vesc.config import VescMotor as TwinMotor
from firmware_sim.drives.vesc.config import VescServoSection, VescSettings
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.vesc.config import VescMotor, VescServo
from robotctl.drivers.can.drives.vesc.state import VescState
from robotctl.drivers.can.drives.vesc.wire import Report
from robotctl.messages.actuators import DriveState
from robotctl.messages.faults import FaultCode
from robotctl.messages.ports import EXTENDED_FLAG
from tests.drivers.can.drives.bench import BRAKE, COAST, MS, NEEDS, PERIOD_NS, TICKS, Bench, on

NUMBER = 10
RATIO = 22.0


def bench(
    settings: dict | None = None, *, reverse: bool = False, host: dict | None = None
) -> Bench:
    """Return a car with a VESC; what is not said is as a user would have it."""
    axes = (("drive", 1, reverse, RATIO), ("steering", 2, reverse, 1.5))
    options = {"brake_current_a": 8.0, "pole_pairs": 4, "node_id": NUMBER, **(host or {})}
    table = VescMotor(
        "vesc",
        "motor",
        tuple(AxisConfig(*each) for each in axes),
        servo=VescServo(0.52, 120.0, 350.0),
        **options,
    )
    true = {"pole_pairs": 4, "node_id": NUMBER}
    others = {"current_a": 15.0}
    for key, value in (settings or {}).items():
        (true if key in TwinMotor.__dataclass_fields__ else others)[key] = value
    section = TwinMotor(
        "vesc",
        "motor",
        tuple(AxisSection(*each) for each in axes),
        servo=VescServoSection(0.52, 120.0, 350.0),
        **true,
    )
    twin = VescSettings(**others)
    return Bench((table, section, twin), name="ackermann")


@pytest.fixture
def car() -> Bench:
    made = bench()
    made.commission()
    made.run(0.1)
    return made


def drive(car: Bench, speed: float = 4.0, seconds: float = 0.6, angle: float = 0.0) -> None:
    car.run(seconds, on(speed, angle))


def test_it_comes_into_service_and_its_time_out_is_set_and_read_back(car):
    status = car.drive.status
    assert (status.node_id, status.nmt_state, status.boots, status.problem) == (NUMBER, 5, 1, "")
    assert (car.twin.timeout_ms, car.twin.brake_current_a) == (80, 8.0)
    assert car.drive.proof == "time-out 80 ms, then it brakes with 8 A"
    assert car.state is DriveState.READY
    assert not car.powered


def test_nothing_else_of_its_configuration_is_changed(car):
    before = bench()
    before.advance(200 * MS)
    assert before.twin.timeout_ms == 1000
    changed = [
        place
        for place, (one, other) in enumerate(
            zip(before.twin._configuration(), car.twin._configuration(), strict=True)
        )
        if one != other
    ]
    assert set(changed) <= set(range(5, 13))


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("speed", [5.0, -5.0])
def test_a_wheel_has_its_speed_and_tells_it_in_its_own_sense(reverse, speed):
    car = bench(reverse=reverse)
    car.commission()
    car.run(0.1)
    begin = car.report.position_ticks
    start = car.turns()
    car.run(1.5, on(speed, 0.0))
    report = car.report
    assert car.state is DriveState.ENABLED
    assert car.speed() == pytest.approx(speed, abs=0.05)
    assert report.speed_rad_s == pytest.approx(speed, abs=0.1)
    moved = (report.position_ticks - begin) / TICKS
    assert moved == pytest.approx(car.turns() - start, abs=0.03)
    assert math.copysign(1.0, report.current_a) == math.copysign(1.0, speed)
    assert report.voltage_v == pytest.approx(car.plant.bus_voltage_v, abs=0.2)
    assert report.temperature_c == pytest.approx(25.0)
    assert report.motion_ns > car.now_ns - 3 * PERIOD_NS
    car.run(0.6, BRAKE)
    assert abs(car.speed()) < 0.05
    assert car.state is DriveState.READY


@pytest.mark.parametrize("reverse", [False, True])
def test_the_servo_steers_in_the_sense_of_the_joint(reverse):
    car = bench(reverse=reverse)
    car.commission()
    drive(car, 1.0, 0.5, angle=0.3)
    assert car.plant.steering_rad == pytest.approx(0.3, abs=0.01)
    assert car.drive.reports[1].angle_rad == pytest.approx(0.3)
    drive(car, 1.0, 0.6, angle=-0.5)
    assert car.plant.steering_rad == pytest.approx(-0.5, abs=0.01)


def test_the_angle_told_follows_at_the_rate_of_the_servo(car):
    drive(car, 1.0, 0.1, angle=0.0)
    car.tick(on(1.0, 0.5))
    told = []
    for _ in range(10):
        car.tick(on(1.0, 0.5))
        told.append(car.drive.reports[1].angle_rad)
    steps = np.diff(told)
    assert steps.max() == pytest.approx(math.radians(350.0) / 1.5 * 0.005, rel=0.01)


def test_without_power_a_wheel_coasts_or_brakes_as_commanded(car):
    speeds = []
    for command in (COAST, BRAKE):
        drive(car, 8.0, 1.0)
        car.run(0.1, command)
        speeds.append(car.speed())
    assert speeds[1] < speeds[0] - 1.0


def test_a_wheel_that_stands_is_held_where_that_is_wanted():
    car = bench(host={"handbrake_current_a": 5.0})
    car.commission()
    car.run(0.1, BRAKE)
    assert (
        car.sent[-2][0] & 0x1FFFFFFF == 12 << 8 | NUMBER
        or (
            EXTENDED_FLAG | 12 << 8 | NUMBER,
            bytes.fromhex("00001388"),
        )
        in car.sent[-6:]
    )


def test_enabled_is_told_only_when_the_drive_says_that_it_takes_commands(car):
    car.takes_frames = False
    for _ in range(10):
        car.tick(on(3.0, 0.0))
        assert car.state is not DriveState.ENABLED
    car.takes_frames = True
    drive(car, 3.0, 0.1)
    assert car.state is DriveState.ENABLED


def test_a_silent_host_leaves_no_power_after_the_time_out():
    rng = np.random.default_rng(4)
    for seed in range(100):
        if seed % 10 == 0:
            car = bench({"stored_timeout_ms": 500 + seed})
            car.commission()
        car.run(0.05)
        car.run(float(rng.uniform(0.05, 0.3)), on(float(rng.uniform(-8.0, 8.0)), 0.1))
        last_ns = car.now_ns
        car.advance(int(rng.integers(0, PERIOD_NS)))
        while car.powered:
            car.advance(MS)
            assert car.now_ns - last_ns <= NEEDS.command_timeout_ms * MS + PERIOD_NS
        car.clear()
        car.run(0.05)


def test_the_car_brakes_after_the_time_out_or_coasts_where_that_is_accepted():
    left = []
    for options in ({}, {"brake_current_a": 0.0, "accept_coasting": True}):
        car = bench(host=options)
        car.commission()
        drive(car, 8.0, 1.0)
        car.advance(500 * MS)
        left.append(car.speed())
    assert abs(left[0]) < 0.1
    assert left[1] > 3.0
    assert car.drive.proof == "time-out 80 ms, then it coasts"


def test_a_host_that_was_held_up_does_not_drive_on_by_itself(car):
    drive(car)
    car.advance(120 * MS)
    car.run(0.3, on(4.0, 0.0))
    assert car.report.fault.code is FaultCode.DRIVE_COMMAND_TIMEOUT
    assert abs(car.speed()) < 0.1
    car.clear()
    car.run(0.3, on(4.0, 0.0))
    assert car.state is DriveState.READY, "a disabled command must come first"
    car.run(0.05)
    drive(car)
    assert car.speed() == pytest.approx(4.0, abs=0.1)


def test_commands_that_do_not_arrive_are_told_by_the_drive_and_latch(car):
    drive(car)
    car.twin._updated_ns -= 10_000 * MS
    car.twin._value = lambda data, now_ns: None
    car.run(0.2, on(4.0, 0.0))
    assert car.state is DriveState.STOPPED
    assert car.report.fault.code is FaultCode.DRIVE_COMMAND_TIMEOUT
    assert "time-out passed" in str(car.report.fault)


CODES = {
    1: (FaultCode.DRIVE_OVER_VOLTAGE, "over voltage"),
    2: (FaultCode.DRIVE_UNDER_VOLTAGE, "under voltage"),
    3: (FaultCode.DRIVE_FAULT, "gate driver"),
    4: (FaultCode.DRIVE_OVER_CURRENT, "over current"),
    5: (FaultCode.DRIVE_OVER_TEMPERATURE, "bridge"),
    6: (FaultCode.DRIVE_OVER_TEMPERATURE, "motor"),
    11: (FaultCode.DRIVE_ENCODER, "SPI of the encoder"),
    24: (FaultCode.DRIVE_PARAMETER, "motor configuration"),
    29: (FaultCode.DRIVE_FAULT, "low-voltage output"),
    200: (FaultCode.DRIVE_FAULT, "not known"),
}


@pytest.mark.parametrize("code", [*range(1, 30), 200])
def test_a_fault_stops_and_stays_though_the_drive_forgets_it(car, code):
    drive(car, 3.0, 0.2)
    car.twin.trip(code)
    drive(car, 3.0, 0.06)
    assert car.state is DriveState.FAULT
    fault = car.report.fault
    assert f"fault {code}: " in fault.text
    assert fault.part == "motor"
    if code in CODES:
        assert fault.code is CODES[code][0]
        assert CODES[code][1] in fault.text
    drive(car, 3.0, 1.0)
    assert car.twin.fault == 0, "it is gone by itself"
    assert car.state is DriveState.FAULT
    assert abs(car.speed()) < 0.1
    car.clear()
    car.run(0.05)
    assert car.state is DriveState.READY
    drive(car, 3.0, 0.3)
    assert car.state is DriveState.ENABLED


def test_a_fault_is_not_cleared_while_it_lasts(car):
    drive(car, 3.0, 0.2)
    car.twin.trip(5)
    drive(car, 3.0, 0.06)
    car.clear()
    for _ in range(20):
        car.tick(COAST)
        assert car.state is DriveState.FAULT


def test_an_answer_to_a_question_before_the_command_does_not_confirm_it():
    state = VescState("motor", 80)
    state.admit(False, True, 0)
    state.ask(100)
    assert state.admit(True, True, 200)
    state.take(Report(0, False, False))
    state.update(True)
    assert state.state is DriveState.READY
    state.ask(200)
    state.take(Report(0, True, False))
    state.update(True)
    assert state.state is DriveState.READY, "its time-out has passed"
    state.take(Report(0, False, False))
    state.update(True)
    assert state.state is DriveState.ENABLED


def test_faults_are_told_by_a_firmware_without_flags_too():
    car = bench({"tells_flags": False})
    car.commission()
    drive(car, 3.0, 0.3)
    assert car.state is DriveState.ENABLED
    car.twin.trip(4)
    drive(car, 3.0, 0.06)
    assert car.report.fault.code is FaultCode.DRIVE_OVER_CURRENT


def test_the_kill_switch_stops_and_stays(car):
    drive(car)
    car.twin.kill_switch = True
    drive(car, 4.0, 0.1)
    assert car.state is DriveState.STOPPED
    assert "kill switch" in str(car.report.fault)
    car.twin.kill_switch = False
    drive(car, 4.0, 0.3)
    assert car.state is DriveState.STOPPED
    assert abs(car.speed()) < 0.5


def test_an_emergency_stop_takes_the_power_at_once_until_faults_are_cleared(car):
    drive(car, 6.0, 1.0)
    car.stop()
    car.advance(2 * MS)
    assert not car.powered
    car.run(0.3, on(6.0, 0.0))
    assert car.state is DriveState.EMERGENCY_STOP
    assert car.report.fault.code is FaultCode.DRIVE_EMERGENCY_STOP
    assert not car.powered
    car.clear()
    car.run(0.1, on(6.0, 0.0))
    assert not car.powered
    car.run(0.05)
    drive(car, 6.0, 0.1)
    assert car.powered


def test_a_request_to_clear_is_dropped_by_an_emergency_stop_after_it(car):
    car.clear()
    car.stop()
    car.run(0.1)
    assert car.state is DriveState.EMERGENCY_STOP


@pytest.mark.parametrize("notifies", [True, False])
def test_a_drive_that_reboots_while_driving_does_not_drive_on(notifies):
    car = bench({"notifies_boot": notifies, "boot_ms": 60})
    car.commission()
    drive(car, 6.0, 1.5)
    car.twin.power_cycle(car.now_ns)
    car.run(0.1, on(6.0, 0.0))
    assert car.drive.status.boots == 2
    car.run(3.0, on(6.0, 0.0))
    assert car.drive.status.problem == "", "it is set anew"
    assert car.twin.timeout_ms == 80
    assert car.state is DriveState.READY
    assert abs(car.speed()) < 0.1
    car.run(0.05)
    drive(car, 6.0, 1.0)
    assert car.speed() == pytest.approx(6.0, abs=0.1)


def test_a_reboot_without_a_word_is_seen_by_the_pause_before_the_wheel_has_turned():
    car = bench({"notifies_boot": False, "boot_ms": 150})
    car.commission()
    car.run(0.05)
    drive(car, 0.05, 0.1)
    car.twin.power_cycle(car.now_ns)
    car.run(0.3, on(0.05, 0.0))
    assert car.drive.status.boots == 2
    car.run(3.0, on(0.05, 0.0))
    assert car.drive.status.problem == ""
    assert car.state is DriveState.READY


def test_a_drive_that_is_gone_is_told_and_comes_back_disabled(car):
    drive(car)
    car.twin._booted = False
    car.twin._awake_ns = car.now_ns + 1000 * MS
    car.run(0.5, on(4.0, 0.0))
    status = car.drive.status
    assert (status.fault, status.nmt_state) == (FaultCode.NODE_SILENT, 0)
    assert status.problem == "motor (node 10): nothing heard for 350 ms"
    assert car.state is DriveState.BOOT
    car.run(3.0, on(4.0, 0.0))
    assert car.drive.status.boots == 2
    assert car.drive.status.problem == ""
    assert car.state is DriveState.READY


def test_a_setting_changed_while_driving_takes_it_out_of_service(car):
    drive(car)
    car.twin.configure(0, 0.0)
    for _ in range(1000):
        car.tick(on(4.0, 0.0))
        if car.drive.status.problem:
            break
    assert car.drive.status.fault is FaultCode.NODE_CHANGED
    assert car.drive.status.problem == (
        "motor (node 10): the drive says time-out 0 ms, then it coasts, wanted time-out 80 ms, "
        "then it brakes with 8 A: it was changed"
    )
    car.run(0.05, on(4.0, 0.0))
    assert not car.powered


def test_an_accepted_time_out_is_read_and_never_written():
    options = {"accept_timeout_ms": 500}
    car = bench(
        {"sets_timeout": False, "stored_timeout_ms": 500, "stored_brake_current_a": 8.0},
        host=options,
    )
    car.commission()
    assert car.drive.proof == "time-out 500 ms, then it brakes with 8 A"
    other = bench({"stored_timeout_ms": 1000, "stored_brake_current_a": 8.0}, host=options)
    other.run(2.0)
    assert other.drive.status.fault is FaultCode.NODE_OTHER_VALUE
    assert "says time-out 1000 ms" in other.drive.status.problem
    assert other.twin.timeout_ms == 1000


@pytest.mark.parametrize(
    ("settings", "code", "words"),
    [
        ({"firmware": (3, 50)}, FaultCode.NODE_OTHER_FIRMWARE, "firmware 3.50 is not known"),
        ({"sets_timeout": False}, FaultCode.NODE_NO_ANSWER, "accept_timeout_ms"),
        ({"status": ()}, FaultCode.NODE_NO_ANSWER, "no status 1 (speed) and no status 5"),
        ({"status": (1, 4)}, FaultCode.NODE_NO_ANSWER, "sends no status 5 (tachometer): enable"),
        ({"servo_output": False}, FaultCode.NODE_OTHER_VALUE, "servo output is off"),
        ({"node_id": 11}, FaultCode.NODE_NOT_HEARD, "not heard on the bus"),
    ],
)
def test_a_drive_that_is_not_as_it_must_be_stays_out_of_service_and_why(settings, code, words):
    car = bench(settings)
    car.run(3.0)
    assert car.drive.status.fault is code
    assert words in car.drive.status.problem
    car.run(0.2, on(3.0, 0.0))
    assert not car.powered
    assert car.drive.proof is None


def test_what_the_drive_does_not_send_is_none():
    car = bench({"status": (1, 5)})
    car.commission()
    drive(car, 3.0, 0.2)
    assert car.report.temperature_c is None
    assert car.report.speed_rad_s is not None


def test_a_sensor_in_the_motor_is_told_where_there_is_one():
    car = bench(host={"motor_temperature": True})
    car.commission()
    drive(car, 8.0, 1.0)
    assert car.report.temperature_c == pytest.approx(car.plant.axes[0].temperature_c, abs=0.1)


@pytest.mark.parametrize("values", [(math.nan, 0.0), (math.inf, 0.0), (3.0, math.nan), (3.0, 1.5)])
def test_what_the_wire_cannot_carry_is_no_power(car, values):
    drive(car, 3.0, 0.3)
    before = NEEDS.notes.refused
    car.run(0.1, on(*values))
    assert not car.powered
    assert NEEDS.notes.refused == before + 20


@pytest.mark.parametrize("command", [9, 16, 27])
@pytest.mark.parametrize("length", [0, 4, 7])
def test_a_status_of_another_layout_stops_the_drive_and_is_quoted(car, command, length):
    drive(car, 3.0, 0.2)
    car.deliver(EXTENDED_FLAG | command << 8 | NUMBER, bytes(range(length)))
    car.tick(on(3.0, 0.0))
    assert car.state is DriveState.FAULT
    assert car.report.fault.code is FaultCode.DRIVE_UNREADABLE
    assert f"{length} bytes" in str(car.report.fault)


def test_a_speed_beyond_the_drive_saturates_and_the_truth_is_told():
    car = bench({"max_erpm": 4 * RATIO * 5.0 * 60 / math.tau})
    car.commission()
    drive(car, 9.0, 1.5)
    assert car.speed() == pytest.approx(5.0, abs=0.05)
    assert car.report.speed_rad_s == pytest.approx(5.0, abs=0.1)


def test_below_its_least_speed_the_loop_lets_go():
    car = bench({"min_erpm": 900.0})
    car.commission()
    drive(car, 0.9 * 900 / (4 * RATIO * 60 / math.tau), 0.5)
    assert not car.powered


def test_wrong_pole_pairs_show_as_a_wrong_speed():
    car = bench({"pole_pairs": 8})
    car.commission()
    drive(car, 4.0, 1.0)
    assert car.speed() == pytest.approx(2.0, abs=0.05)
    assert car.report.speed_rad_s == pytest.approx(4.0, abs=0.1)


def test_the_tachometer_may_roll_over(car):
    tacho = (1 << 31) - 100
    car.twin._turns_at_boot = car.twin._motor.turns - tacho / 24
    car.tick(COAST)  # frames on their way
    car.drive._feedback._tachometer = None
    boots = car.drive.status.boots
    drive(car, 8.0, 0.1)
    assert car.drive._feedback._tachometer.value < 1 << 31
    begin, start = car.report.position_ticks, car.turns()
    drive(car, 8.0, 1.0)
    moved = (car.report.position_ticks - begin) / TICKS
    assert moved == pytest.approx(car.turns() - start, abs=0.03)
    assert car.drive._feedback._tachometer.value > 1 << 31
    assert car.drive.status.boots == boots


def test_two_drives_share_a_bus():
    tables = []
    for number, (wheel, reverse) in enumerate((("left", False), ("right", True)), 1):
        axes = ((wheel, 1, reverse, 20.0),)
        tables.append(
            (
                VescMotor(
                    "vesc",
                    wheel,
                    tuple(AxisConfig(*each) for each in axes),
                    node_id=number,
                    brake_current_a=5.0,
                ),
                TwinMotor(
                    "vesc", wheel, tuple(AxisSection(*each) for each in axes), node_id=number
                ),
                VescSettings(current_a=10.0),
            )
        )
    both = Bench(*tables)
    both.commission()
    both.run(1.0, on(3.0), on(-3.0))
    assert both.speed(0) == pytest.approx(3.0, abs=0.05)
    assert both.speed(1) == pytest.approx(-3.0, abs=0.05)
    assert [each.reports[0].state for each in both.drives] == [DriveState.ENABLED] * 2


def test_reports_stay_the_same_object_while_nothing_comes(car):
    car.run(0.05)
    before = car.drive.reports
    car.drive.check(car.now_ns)
    assert car.drive.reports is before


def test_a_time_out_that_the_drive_cannot_keep_is_refused():
    with pytest.raises(ValueError, match="at least 20 for the VESC 'motor', not 15"):
        Bench(
            (
                VescMotor("vesc", "motor", (AxisConfig("drive"),), brake_current_a=1.0),
                TwinMotor("vesc", "motor", (AxisSection("drive"),)),
                VescSettings(),
            ),
            name="ackermann",
            needs=dataclasses.replace(NEEDS, command_timeout_ms=15),
        )
