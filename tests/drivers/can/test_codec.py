import math
from pathlib import Path

import pytest
from e2e import p01
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.drivers.can.codec import compile_decoder, compile_encoder, compile_syndrome
from robotctl.drivers.can.dbc import load_dbc

DBC = load_dbc(Path(__file__).parents[3] / "configs" / "robot.dbc")
MESSAGES = sorted(DBC.messages)
PROTECTED = [name for name in MESSAGES if DBC.message(name).protection]


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_frame_decodes_as_with_cantools(oracle, name, data):
    message = DBC.message(name)
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    names = list(message.signals)
    expected = oracle.get_message_by_name(name).decode(payload, decode_choices=False)
    assert dict(zip(names, compile_decoder(message, names)(payload), strict=True)) == expected


@pytest.mark.parametrize("name", MESSAGES)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_frame_encodes_as_with_cantools_and_autosar_e2e(oracle, name, data):
    message = DBC.message(name)
    values = {}
    for signal in message.signals.values():
        if message.protection and signal.name == message.protection.crc:
            continue
        raw = data.draw(st.integers(signal.raw_minimum, signal.raw_maximum), label=signal.name)
        values[signal.name] = (
            raw if signal.scale == 1 and signal.offset == 0 else raw * signal.scale + signal.offset
        )
    payload = compile_encoder(message, list(values))(*values.values())
    if message.protection is None:
        assert payload == oracle.get_message_by_name(name).encode(values)
    else:
        expected = bytearray(oracle.get_message_by_name(name).encode({**values, "Crc": 0}))
        p01.e2e_p01_protect(expected, message.protection.data_id, length=8, increment_counter=False)
        assert payload == expected


@settings(max_examples=300, deadline=None)
@given(
    duty=st.floats(-1, 1),
    steering=st.floats(-1.5708, 1.5708),
    counter=st.integers(0, 14),
    enable=st.booleans(),
)
def test_any_float_in_range_is_quantised_as_by_cantools(oracle, duty, steering, counter, enable):
    encode = compile_encoder(
        DBC.message("MotorCommand"), ("Counter", "Enable", "Duty1", "SteeringAngle")
    )
    expected = oracle.get_message_by_name("MotorCommand").encode(
        {
            "Crc": 0,
            "Counter": counter,
            "Enable": enable,
            "Brake": 0,
            "Duty1": duty,
            "Duty2": 0,
            "SteeringAngle": steering,
        }
    )
    assert encode(counter, enable, duty, steering)[1:] == expected[1:]


@pytest.mark.parametrize("name", PROTECTED)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_the_crc_check_agrees_with_autosar_e2e_on_any_eight_bytes(name, data):
    message = DBC.message(name)
    payload = bytearray(data.draw(st.binary(min_size=8, max_size=8)))
    payload[1] &= 0xEF if payload[1] & 15 == 15 else 0xFF
    syndrome = compile_syndrome(message)
    sealed = bytearray(payload)
    p01.e2e_p01_protect(sealed, message.protection.data_id, length=8, increment_counter=False)
    assert syndrome(bytes(sealed)) == 0
    assert (syndrome(bytes(payload)) == 0) == (payload[0] == sealed[0])


@pytest.mark.parametrize("name", PROTECTED)
def test_any_error_of_one_bit_and_any_burst_of_eight_is_found(name):
    syndrome = compile_syndrome(DBC.message(name))
    sealed = bytearray(range(8))
    p01.e2e_p01_protect(
        sealed, DBC.message(name).protection.data_id, length=8, increment_counter=False
    )
    good = int.from_bytes(sealed, "big")
    for shift in range(57):
        for pattern in (0x01, 0x80, 0xFF, 0x81, 0xA5):
            assert syndrome((good ^ pattern << shift).to_bytes(8, "big")) != 0


def test_a_frame_of_one_message_does_not_pass_as_another():
    frame = compile_encoder(DBC.message("MotorStatus"), ("Counter",))(3)
    assert compile_syndrome(DBC.message("MotorStatus"))(frame) == 0
    assert compile_syndrome(DBC.message("DriveStatus"))(frame) != 0


@pytest.mark.parametrize(
    ("duty", "steering"),
    [(1.0001, 0), (-1.0001, 0), (3.9, 0), (1e30, 0), (0, 1.6), (math.nan, 0), (0, math.nan)],
)
def test_a_value_out_of_range_is_refused(codec, duty, steering):
    with pytest.raises(ValueError, match=r"out of range|NaN"):
        codec.encode_command(0, 1, 0, duty, 0.0, steering)


@pytest.mark.parametrize("duty", [math.inf, -math.inf])
def test_an_infinite_value_is_refused(codec, duty):
    with pytest.raises(OverflowError):
        codec.encode_command(0, 1, 0, duty, 0.0, 0.0)


def test_the_refusal_names_the_signal_and_its_value(codec):
    with pytest.raises(ValueError, match=r"MotorCommand\.Duty2: -1\.5  is out of range"):
        codec.encode_command(0, 1, 0, 0.0, -1.5, 0.0)


def test_counter_fifteen_is_never_sent(codec):
    with pytest.raises(ValueError, match="Counter"):
        codec.encode_command(15, 0, 0, 0.0, 0.0, 0.0)


def test_a_message_without_protection_has_no_crc_check():
    with pytest.raises(ValueError, match="Sync has no E2E protection"):
        compile_syndrome(DBC.message("Sync"))


@settings(max_examples=200, deadline=None)
@given(raws=st.lists(st.sampled_from([0, 1, 8189, 8190, 8191]), min_size=4, max_size=4))
def test_sonar_ranges_tell_no_echo_from_no_sensor(codec, raws):
    message = DBC.message("SonarRangesC")
    names = [f"Range{index}" for index in range(8, 12)]
    frame = compile_encoder(message, names)(*(raw * 0.001 for raw in raws))
    for raw, range_m in zip(raws, codec.readers["SonarRangesC"](frame, 5).ranges_m, strict=True):
        if raw == 8190:
            assert math.isnan(range_m)
        else:
            assert range_m == (math.inf if raw == 8191 else raw * 0.001)
