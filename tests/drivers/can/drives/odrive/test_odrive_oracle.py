"""Frames of both sides of an ODrive against the DBC files of the package odrive-can."""

from __future__ import annotations

import struct
from functools import cache

import pytest
from odrive_can import get_dbc

from robotctl.messages.actuators import DriveState
from robotctl.messages.control import EmergencyStopSource
from robotctl.messages.faults import FaultCode
from tests.drivers.can.drives.odrive.rig import NEW, OLD, TICKS_PER_TURN, Rig

REMOTE = 0x4000_0000
ESTOP = 0x02
VERSIONS = {"0.5.6": OLD, "0.6.10": NEW}
BOTH = pytest.mark.parametrize("version", VERSIONS)


@cache
def database(version):
    return get_dbc(f"odrive-cansimple-{version}")


def message(version, command):
    return database(version).get_message_by_frame_id(command)


def encode(version, name, **values):
    found = database(version).get_message_by_name(f"Axis0_{name}")
    return found.frame_id, found.encode({signal.name: 0 for signal in found.signals} | values)


def rig_of(version, **settings):
    return Rig(**{**VERSIONS[version], **settings})


@BOTH
def test_every_frame_of_both_sides_is_one_of_the_dbc(version):
    rig = rig_of(version, pads_sdo=True, motor_thermistor=True)
    told = []
    rig.bus.attach("tap", told.append)
    rig.start().enable(3.0, -3.0)
    rig.run(300)
    rig.twins[0].trip(0x20000, "motor")
    rig.run(100)
    rig.drives[0].clear_faults()
    rig.drives[1].emergency_stop(rig.send, EmergencyStopSource.OPERATOR)
    rig.stop()
    rig.run(500)
    commands = set()
    for frame in told:
        command = frame.arbitration_id & 0x1F
        commands.add(command)
        if version == "0.5.6" and command in (ESTOP, 0x00):
            continue  # Estop is in can_simple.cpp alone; Get_Version is what tells 0.6 apart
        known = message(version, command)
        assert len(frame.data) == known.length or frame.arbitration_id & REMOTE
        if not frame.arbitration_id & REMOTE:
            values = known.decode(frame.data, decode_choices=False)
            assert known.encode(values) == frame.data
    both = {0x01, 0x02, 0x03, 0x07, 0x09, 0x0B, 0x0D, 0x14, 0x17, 0x18}
    only = {"0.5.6": {0x00, 0x04, 0x0A, 0x1D}, "0.6.10": {0x00, 0x04, 0x05, 0x15}}[version]
    assert commands == both | only


@BOTH
def test_the_host_sends_what_the_dbc_encodes(version):
    rig = rig_of(version).start().enable(6.283185307179586, 3.0)
    rig.run(50)
    rig.drives[0].clear_faults()
    rig.stop()
    rig.run(50)
    sent = {(can_id, data) for _, can_id, data in rig.sent if can_id >> 5 == 33}
    for name, values in (
        ("Set_Controller_Mode", {"Control_Mode": "VELOCITY_CONTROL", "Input_Mode": "PASSTHROUGH"}),
        ("Set_Axis_State", {"Axis_Requested_State": "CLOSED_LOOP_CONTROL"}),
        ("Set_Axis_State", {"Axis_Requested_State": "IDLE"}),
        ("Set_Input_Vel", {"Input_Vel": 1.0}),
        ("Clear_Errors", {}),
    ):
        command, data = encode(version, name, **values)
        assert (33 << 5 | command, data) in sent
    # The right wheel: mounted the other way round, and geared 8:1.
    command, data = encode(version, "Set_Input_Vel", Input_Vel=-8 * 3.0 / 6.283185307179586)
    assert any(can_id == 34 << 5 | command and data == each for _, can_id, each in rig.sent)


def test_the_watchdog_of_0_6_is_written_to_its_endpoints():
    rig = rig_of("0.6.10").start()
    sent = {(can_id, data) for _, can_id, data in rig.sent if can_id >> 5 == 33}
    timeout = struct.unpack("<I", struct.pack("<f", 0.09))[0]
    for values in (
        {"Opcode": "WRITE", "Endpoint_ID": 213, "Value": timeout},
        {"Opcode": "READ", "Endpoint_ID": 213},
        {"Opcode": "WRITE", "Endpoint_ID": 214, "Value": 1},
        {"Opcode": "READ", "Endpoint_ID": 214},
    ):
        command, data = encode("0.6.10", "RxSdo", **values)
        assert (33 << 5 | command, data) in sent


@BOTH
def test_the_host_reads_what_the_dbc_encodes(version):
    rig = rig_of(version).start()
    for name, values in (
        ("Get_Encoder_Estimates", {"Pos_Estimate": -16.0, "Vel_Estimate": 2.5}),
        ("Get_Iq", {"Iq_Setpoint": 1.0, "Iq_Measured": -4.0}),
        ("Get_Bus_Voltage_Current", {"Bus_Voltage": 24.5, "Bus_Current": 1.0}),
        ("Heartbeat", {"Axis_State": "CLOSED_LOOP_CONTROL"}),
    ):
        rig.deliver(34, *encode(version, name, **values))
    if version == "0.6.10":
        values = {"FET_Temperature": 50.0, "Motor_Temperature": 61.0}
        rig.deliver(34, *encode(version, "Get_Temperature", **values))
    rig.drives[1].check(rig.now_ns)
    report = rig.report(1)
    assert report.position_ticks == 2 * TICKS_PER_TURN
    assert report.speed_rad_s == pytest.approx(-2.5 / 8 * 2 * 3.141592653589793)
    assert report.current_a == 4.0
    assert report.voltage_v == 24.5
    assert report.state is DriveState.ENABLED
    assert report.temperature_c == (61.0 if version == "0.6.10" else None)


def errors_of(version, name, signal):
    found = database(version).get_message_by_name(f"Axis0_{name}")
    choices = found.get_signal_by_name(signal).choices
    return [(bit, str(word)) for bit, word in choices.items() if bit]


OLD_ERRORS = [
    (name, 0x00, bit, word)
    for name, signal in (
        ("Get_Motor_Error", "Motor_Error"),
        ("Get_Encoder_Error", "Encoder_Error"),
        ("Get_Controller_Error", "Controller_Error"),
    )
    for bit, word in errors_of("0.5.6", name, signal)
]


@pytest.mark.parametrize(("name", "_", "bit", "word"), OLD_ERRORS)
def test_each_error_of_a_part_of_0_5_is_told_by_name(name, _, bit, word):
    rig = rig_of("0.5.6").start()
    command = database("0.5.6").get_message_by_name(f"Axis0_{name}").frame_id
    rig.deliver(33, command, struct.pack("<Q", bit))
    rig.drives[0].check(rig.now_ns)
    part = name.split("_")[1].lower()
    assert f"{part} {word}" in str(rig.faults[0])
    assert "not known" not in str(rig.faults[0])
    assert rig.states[0] is DriveState.FAULT


@pytest.mark.parametrize(("bit", "word"), errors_of("0.5.6", "Heartbeat", "Axis_Error"))
def test_each_error_of_the_axis_of_0_5_is_told_by_name(bit, word):
    rig = rig_of("0.5.6").start()
    rig.deliver(33, *encode("0.5.6", "Heartbeat", Axis_Error=bit, Axis_State="IDLE"))
    rig.drives[0].check(rig.now_ns)
    assert f"axis {word}" in str(rig.faults[0])


@pytest.mark.parametrize("signal", ["Active_Errors", "Disarm_Reason"])
@pytest.mark.parametrize(("bit", "word"), errors_of("0.6.10", "Get_Error", "Active_Errors"))
def test_each_error_of_0_6_is_told_by_name(signal, bit, word):
    rig = rig_of("0.6.10").start()
    rig.deliver(33, *encode("0.6.10", "Get_Error", **{signal: bit}))
    rig.drives[0].check(rig.now_ns)
    if word == "INITIALIZING":
        assert rig.faults[0] is None
        return
    assert f"reports {word}" in str(rig.faults[0])


CODES = {
    "DC_BUS_OVER_VOLTAGE": FaultCode.DRIVE_OVER_VOLTAGE,
    "DC_BUS_UNDER_VOLTAGE": FaultCode.DRIVE_UNDER_VOLTAGE,
    "DC_BUS_OVER_CURRENT": FaultCode.DRIVE_OVER_CURRENT,
    "CURRENT_LIMIT_VIOLATION": FaultCode.DRIVE_OVER_CURRENT,
    "MOTOR_OVER_TEMP": FaultCode.DRIVE_OVER_TEMPERATURE,
    "INVERTER_OVER_TEMP": FaultCode.DRIVE_OVER_TEMPERATURE,
    "MISSING_ESTIMATE": FaultCode.DRIVE_ENCODER,
    "SPINOUT_DETECTED": FaultCode.DRIVE_ENCODER,
    "WATCHDOG_TIMER_EXPIRED": FaultCode.DRIVE_COMMAND_TIMEOUT,
    "ESTOP_REQUESTED": FaultCode.DRIVE_EMERGENCY_STOP,
    "BAD_CONFIG": FaultCode.DRIVE_PARAMETER,
    "DRV_FAULT": FaultCode.DRIVE_FAULT,
    "BRAKE_RESISTOR_DISARMED": FaultCode.DRIVE_FAULT,
}


@pytest.mark.parametrize("word", CODES)
def test_errors_of_0_6_have_their_codes(word):
    rig = rig_of("0.6.10").start()
    rig.deliver(33, *encode("0.6.10", "Get_Error", Disarm_Reason=word))
    rig.drives[0].check(rig.now_ns)
    assert rig.faults[0].code is CODES[word]


def test_errors_that_are_not_known_are_told_by_their_number():
    rig = rig_of("0.6.10").start()
    rig.deliver(33, 0x03, struct.pack("<II", 0x00800000, 0))
    rig.drives[0].check(rig.now_ns)
    assert "0x800000" in str(rig.faults[0])
    assert rig.faults[0].code is FaultCode.DRIVE_FAULT


@BOTH
def test_the_twin_tells_its_state_as_the_dbc_has_it(version):
    rig = rig_of(version, boot_ms=10.0)
    told = []
    rig.bus.attach("tap", told.append)
    rig.start().enable(3.0, 3.0)
    rig.run(200)
    turns = [twin._motor.turns for twin in rig.twins]
    newest = {frame.arbitration_id: frame.data for frame in told}
    for place, node_id in enumerate((33, 34)):
        beat = message(version, 0x01).decode(newest[node_id << 5 | 0x01])
        assert (str(beat["Axis_State"]), beat["Axis_Error"]) == ("CLOSED_LOOP_CONTROL", "NONE")
        estimates = message(version, 0x09).decode(newest[node_id << 5 | 0x09])
        assert estimates["Pos_Estimate"] == pytest.approx(turns[place], abs=0.05)
        speed = (3.0, -24.0)[place] / 6.283
        assert estimates["Vel_Estimate"] == pytest.approx(speed, rel=0.1)
    rig.twins[0].trip(0x01000000 if version == "0.6.10" else 0x800)
    rig.run(150)
    newest = {frame.arbitration_id: frame.data for frame in told}
    beat = message(version, 0x01).decode(newest[33 << 5 | 0x01])
    assert (str(beat["Axis_State"]), str(beat["Axis_Error"])) == ("IDLE", "WATCHDOG_TIMER_EXPIRED")
