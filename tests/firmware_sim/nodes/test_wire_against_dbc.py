"""Every frame of the firmware against cantools and robot.dbc, both ways."""

from __future__ import annotations

import math
import zlib
from pathlib import Path

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.nodes import wire
from firmware_sim.nodes.drive import MAX_COUNTER_STEP, TROUBLES, DriveFault
from firmware_sim.nodes.drive_state import DriveState
from firmware_sim.nodes.e2e import Protector

DBC = Path(__file__).parents[3] / "configs" / "robot.dbc"


def bits(width):
    return st.integers(0, 2**width - 1)


def signed(width):
    return st.integers(-(2 ** (width - 1)), 2 ** (width - 1) - 1)


def scaled(raw, factor):
    """Value of a raw number, off the grid by less than half a step."""
    return st.tuples(raw, st.floats(-0.4, 0.4)).map(lambda pair: (pair[0], (sum(pair)) * factor))


def assert_same(database, name, payload, signals):
    """`payload` is what cantools packs of `signals`, and cantools reads it back."""
    message = database.get_message_by_name(name)
    packed = message.encode(
        {"Crc": 0, "Counter": 0, **signals}, scaling=False, strict=False, padding=False
    )
    assert payload.to_bytes(8, "little") == packed
    sent = Protector(message.dbc.attributes["E2E_DataId"].value).protect(payload)
    decoded = message.decode(sent, scaling=False, decode_choices=False)
    assert {key: decoded[key] for key in signals} == signals


@given(timestamp=bits(20), count1=bits(16), count2=bits(16), turns=st.integers(-3, 3))
def test_wheel_feedback_rolls_over_as_the_dbc_says(database, timestamp, count1, count2, turns):
    payload = wire.wheel_feedback(
        timestamp + turns * 2**20, count1 + turns * 2**16, count2 - turns * 2**16
    )
    signals = {"Timestamp": timestamp, "Count1": count1, "Count2": count2}
    assert_same(database, "WheelFeedback", payload, signals)


@given(
    state=st.sampled_from(DriveState),
    current1=scaled(signed(12), 0.05),
    current2=scaled(signed(12), 0.05),
    temperature1=scaled(bits(8), 1.0),
    temperature2=scaled(bits(8), 1.0),
    faults=bits(6),
)
def test_motor_status(database, state, current1, current2, temperature1, temperature2, faults):
    payload = wire.motor_status(
        state, current1[1], current2[1], temperature1[1] - 40, temperature2[1] - 40, faults=faults
    )
    names = ("OverCurrent", "OverTemperature", "UnderVoltage", "Encoder", "CommandTimeout")
    signals = {
        "State": int(state),
        "Current1": current1[0],
        "Current2": current2[0],
        "Temperature1": temperature1[0],
        "Temperature2": temperature2[0],
        **{f"Fault{name}": faults >> bit & 1 for bit, name in enumerate((*names, "Parameter"))},
    }
    assert_same(database, "MotorStatus", payload, signals)


@given(
    echo=bits(4),
    steering=scaled(signed(16), 1e-4),
    voltage=scaled(bits(16), 1e-3),
    age=bits(8),
    rejected=st.integers(0, 10_000),
)
def test_drive_status(database, echo, steering, voltage, age, rejected):
    payload = wire.drive_status(echo, steering[1], voltage[1], age, rejected)
    signals = {
        "EchoCounter": echo,
        "SteeringAngle": steering[0],
        "BusVoltage": voltage[0],
        "CommandAge": age,
        "RejectedCommands": rejected % 256,
    }
    assert_same(database, "DriveStatus", payload, signals)


@pytest.mark.parametrize("group", range(4))
@given(raw=st.lists(st.integers(0, 8189), min_size=4, max_size=4), odd=bits(8))
def test_sonar_ranges_of_all_groups(database, group, raw, odd):
    values = [each * 1e-3 for each in raw]
    for sonar in range(4):
        kind = odd >> 2 * sonar & 3
        if kind:
            values[sonar] = (math.inf, math.nan, 9.0)[kind - 1]
            raw[sonar] = (8191, 8190, 8191)[kind - 1]
    signals = {f"Range{4 * group + sonar}": value for sonar, value in enumerate(raw)}
    name = "SonarRanges" + "ABCD"[group]
    assert database.get_message_by_name(name).frame_id == wire.SONAR_RANGES[group]
    assert_same(database, name, wire.sonar_ranges(tuple(values)), signals)


@pytest.mark.parametrize(
    ("name", "signal", "scale", "pack"),
    [
        ("ImuGyro", "Rate", 0.0005, wire.imu_gyro),
        ("ImuAccelerometer", "Force", 0.002, wire.imu_accelerometer),
    ],
)
@given(data=st.data())
def test_the_axes_of_the_imu(database, name, signal, scale, pack, data):
    axes = [data.draw(scaled(signed(16), scale)) for _ in "XYZ"]
    signals = {f"{signal}{axis}": raw for axis, (raw, _) in zip("XYZ", axes, strict=True)}
    assert_same(database, name, pack(tuple(value for _, value in axes)), signals)


@given(
    voltage=scaled(bits(16), 1e-3),
    current=scaled(signed(16), 1e-2),
    charge=scaled(st.integers(0, 200), 0.005),
    temperature=scaled(bits(8), 1.0),
    flags=bits(2),
)
def test_battery(database, voltage, current, charge, temperature, flags):
    payload = wire.battery(voltage[1], current[1], charge[1], temperature[1] - 40, flags)
    signals = {
        "BatteryLow": flags & 1,
        "BatteryCritical": flags >> 1,
        "Voltage": voltage[0],
        "Current": current[0],
        "Charge": charge[0],
        "Temperature": temperature[0],
    }
    assert_same(database, "Battery", payload, signals)


@pytest.mark.parametrize("value", [1e9, math.inf, math.nan])
def test_values_beyond_a_field_become_the_nearest_it_can_hold(database, value):
    status = database.get_message_by_name("MotorStatus")
    for sign in (1, -1):
        payload = wire.motor_status(0, sign * value, 0.0, sign * value, 0.0, faults=0)
        decoded = status.decode(payload.to_bytes(8, "little"))
        high = sign > 0 or math.isnan(value)
        assert decoded["Current1"] == pytest.approx(102.35 if high else -102.4)
        assert decoded["Temperature1"] == (215 if high else -40)


@given(
    enable=bits(1),
    brake=bits(1),
    duty1=st.integers(-10_000, 10_000),
    duty2=st.integers(-10_000, 10_000),
    steering=st.integers(-15_708, 15_708),
    counter=st.integers(0, 14),
)
def test_a_command_packed_by_cantools_is_understood(
    database, enable, brake, duty1, duty2, steering, counter
):
    message = database.get_message_by_name("MotorCommand")
    data = message.encode(
        {
            "Crc": 0,
            "Counter": counter,
            "Enable": enable,
            "Brake": brake,
            "Duty1": duty1,
            "Duty2": duty2,
            "SteeringAngle": steering,
        },
        scaling=False,
    )
    command = wire.motor_command(data)
    assert command is not None
    assert (command.enable, command.brake) == (bool(enable), bool(brake))
    assert command.duty1 == pytest.approx(duty1 * 1e-4)
    assert command.duty2 == pytest.approx(duty2 * 1e-4)
    assert command.steering_rad == pytest.approx(steering * 1e-4)


@pytest.mark.parametrize("offset", [2, 4])
@pytest.mark.parametrize(
    ("raw", "valid"),
    [(10_000, True), (10_001, False), (-10_000, True), (-10_001, False), (-32768, False)],
)
def test_a_duty_beyond_full_makes_the_command_invalid(offset, raw, valid):
    data = bytearray(8)
    data[offset : offset + 2] = raw.to_bytes(2, "little", signed=True)
    assert (wire.motor_command(bytes(data)) is not None) is valid


@pytest.mark.parametrize(
    ("raw", "valid"), [(15_708, True), (15_709, False), (-15_708, True), (-15_709, False)]
)
def test_a_steering_angle_beyond_the_dbc_makes_the_command_invalid(raw, valid):
    data = bytes(6) + raw.to_bytes(2, "little", signed=True)
    assert (wire.motor_command(data) is not None) is valid


@given(code=bits(16), register=bits(8), detail=st.binary(max_size=5))
def test_emergency_messages(database, code, register, detail):
    message = database.get_message_by_name("DriveEmergency")
    decoded = message.decode(wire.emergency(code, register, detail))
    assert decoded["ErrorCode"] == code
    assert decoded["ErrorRegister"] == register
    assert decoded["ManufacturerError"] == int.from_bytes(detail, "little")


def test_the_identifiers_are_those_of_the_dbc(database):
    expected = {
        "NmtControl": wire.NMT,
        "EmergencyStop": wire.EMERGENCY_STOP,
        "Sync": wire.SYNC,
        "MotorCommand": wire.MOTOR_COMMAND,
        "WheelFeedback": wire.WHEEL_FEEDBACK,
        "MotorStatus": wire.MOTOR_STATUS,
        "DriveStatus": wire.DRIVE_STATUS,
        "Battery": wire.BATTERY,
        "ImuGyro": wire.IMU_GYRO,
        "ImuAccelerometer": wire.IMU_ACCELEROMETER,
    }
    for number, node in enumerate(("Drive", "Sonar", "Power", "Imu"), start=1):
        expected[f"{node}Emergency"] = wire.EMERGENCY_BASE + number
        expected[f"{node}SdoRequest"] = wire.SDO_REQUEST_BASE + number
        expected[f"{node}SdoResponse"] = wire.SDO_RESPONSE_BASE + number
        expected[f"{node}Heartbeat"] = wire.HEARTBEAT_BASE + number
    expected |= {f"SonarRanges{'ABCD'[group]}": wire.SONAR_RANGES[group] for group in range(4)}
    assert {each.name: each.frame_id for each in database.messages} == expected


def test_the_data_ids_and_the_counter_step_are_those_of_the_dbc(database):
    protected = 0
    for message in database.messages:
        attributes = message.dbc.attributes
        if "E2E_DataId" in attributes:
            protected += 1
            assert wire.data_id(message.frame_id) == attributes["E2E_DataId"].value
            assert attributes["E2E_MaxDeltaCounter"].value == MAX_COUNTER_STEP
    assert protected == 11


def test_states_and_faults_are_those_of_the_dbc(database):
    status = database.get_message_by_name("MotorStatus")
    names = {
        number: str(name) for number, name in status.get_signal_by_name("State").choices.items()
    }
    assert names == {int(state): state.name.lower() for state in DriveState}
    starts = {
        f"FAULT{fault.name.replace('_', '')}": 56 + index for index, fault in enumerate(DriveFault)
    }
    assert starts == {
        each.name.upper(): each.start for each in status.signals if each.name.startswith("Fault")
    }
    assert set(TROUBLES) == set(DriveFault)


def test_the_firmware_implements_this_very_dbc():
    """Fails when robot.dbc changes: check `wire.py` against it, then give both files its CRC."""
    assert zlib.crc32(DBC.read_bytes()) == wire.PROTOCOL_VERSION


def test_no_two_protected_frames_share_the_crc_of_their_data_ids(database):
    ids = [
        message.dbc.attributes["E2E_DataId"].value
        for message in database.messages
        if "E2E_DataId" in message.dbc.attributes
    ]
    crcs = set()
    for data_id in ids:
        data = bytearray(8)
        p01.e2e_p01_protect(data, data_id, length=8, increment_counter=False)
        crcs.add(data[0])
    # A data id of 0 adds nothing: as if the sender knew of none.
    assert 0 not in crcs
    assert len(crcs) == len(ids) == 11
