import zlib
from pathlib import Path

import pytest

from robotctl.drivers.can.config import NodeParameters
from robotctl.drivers.can.dbc import load_dbc
from robotctl.drivers.can.nodes.robot_codec import RobotCodec
from robotctl.errors import ConfigError
from robotctl.messages.ports import EXTENDED_FLAG
from tests.drivers.can.dbc_files import FORMATS
from tests.native_frames import native_parts

ROBOT_DBC = Path(__file__).parents[3] / "configs" / "robot.dbc"


def test_the_wire_version_is_the_crc32_of_the_files_bytes(dbc):
    assert dbc.wire_version == zlib.crc32(ROBOT_DBC.read_bytes())


def test_every_message_and_signal_says_the_same_as_cantools(dbc, oracle):
    assert len(dbc.messages) == len(oracle.messages) == 30
    for expected in oracle.messages:
        message = dbc.message(expected.name)
        assert message.arbitration_id == expected.frame_id
        assert message.length == expected.length
        assert set(message.signals) == {signal.name for signal in expected.signals}
        assert message.cycle_ms == (expected.cycle_time or 0)
        assert message.receivers == expected.receivers


def test_process_data_are_protected_with_the_data_id_of_their_identifier(dbc):
    protected = {m.arbitration_id: m.protection for m in dbc.messages.values() if m.protection}
    assert set(protected) == {
        0x201, 0x181, 0x281, 0x381, 0x182, 0x282, 0x382, 0x482, 0x183, 0x184, 0x284,
    }  # fmt: skip
    for arbitration_id, protection in protected.items():
        # The CRC-8 of 0xA382 would be that of 0xA201: see the codec.
        assert protection.data_id == {0x382: 0xB382}.get(arbitration_id, 0xA000 + arbitration_id)
        assert protection.max_delta == 3


def test_the_range_of_a_signal_bounds_its_raw_values(dbc):
    duty = dbc.signal("MotorCommand", "Duty1")
    assert (duty.raw_minimum, duty.raw_maximum) == (-10000, 10000)
    counter = dbc.signal("MotorCommand", "Counter")
    assert (counter.raw_minimum, counter.raw_maximum) == (0, 14)
    temperature = dbc.signal("Battery", "Temperature")
    assert (temperature.raw_minimum, temperature.raw_maximum) == (0, 255)
    data = dbc.signal("DriveSdoRequest", "SdoData")
    assert (data.raw_minimum, data.raw_maximum) == (0, 2**64 - 1)


def test_the_host_listens_to_what_is_sent_to_it(dbc, oracle):
    expected = {m.frame_id for m in oracle.messages if "HOST" in m.receivers}
    assert set(dbc.received_by("HOST")) == expected
    assert 0x181 in expected
    assert 0x201 not in expected


def test_the_host_also_lets_in_what_others_send_in_its_place(codec, dbc):
    parts = native_parts(codec, NodeParameters(200, 90, 350, sonars=16, imu=True))
    foreign = {0x000, 0x001, 0x080, 0x201, 0x601, 0x602, 0x603, 0x604}
    assert set(parts.identifiers("")) == {*foreign, *dbc.received_by("HOST")}


def refusal(path):
    with pytest.raises(ConfigError) as error:
        RobotCodec(load_dbc(path))
    return str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "BO_ 385 WheelFeedback:",
            "BO_ 385 WheelFeedbak:",
            'WheelFeedback is missing; did you mean "WheelFeedbak"?',
        ),
        (
            "SG_ Duty1 :",
            "SG_ Dut1 :",
            'MotorCommand: signal Duty1 is missing; did you mean "Dut1"?',
        ),
        (
            'BA_ "E2E_DataId" BO_ 385 41345;',
            "",
            "WheelFeedback: attribute E2E_DataId is missing",
        ),
        (
            'BA_ "E2E_DataId" BO_ 898 45954;',
            'BA_ "E2E_DataId" BO_ 898 41858;',
            "SonarRangesC: its E2E_DataId 0xA382 has the CRC of MotorCommand's 0xA201, so",
        ),
        (
            'BA_ "E2E_CounterSignal" BO_ 513 "Counter";',
            'BA_ "E2E_CounterSignal" BO_ 513 "Countr";',
            'MotorCommand: E2E_CounterSignal Countr: no such signal; did you mean "Counter"?',
        ),
        (
            "SG_ Counter : 8|4@1+ (1,0) [0|14] \"\" HOST\n SG_ Timestamp : 12|20@1+",
            "SG_ Counter : 11|4@0+ (1,0) [0|14] \"\" HOST\n SG_ Timestamp : 12|20@1+",
            "WheelFeedback.Counter: is big-endian or a float, profile 1 has neither",
        ),
        (
            "SG_ Counter : 8|4@1+ (1,0) [0|14] \"\" HOST\n SG_ Timestamp : 12|20@1+",
            "SG_ Counter : 28|4@1+ (1,0) [0|14] \"\" HOST\n SG_ Timestamp : 8|20@1+",
            "WheelFeedback.Counter: is at bit 28 with 4 bits, profile 1 has it at bit 8 with 4",
        ),
        (
            'VAL_ 641 State 5 "emergency_stop" 4 "fault"',
            'VAL_ 641 State 4 "emergency_stop" 5 "fault"',
            "MotorStatus.State: fault is 5, must be 4",
        ),
        (
            'VAL_ 386 Range0 8191 "no_echo"',
            'VAL_ 386 Range0 8191 "no_eco"',
            'SonarRangesA.Range0: value no_echo is missing; did you mean "no_eco"?',
        ),
        (
            'BA_ "E2E_DataId" BO_ 387',
            f'{FORMATS}BA_ "VFrameFormat" BO_ 387 14;\nBA_ "E2E_DataId" BO_ 387',
            "Battery: is protected and has 8 bytes of CAN FD, must have 8 of classic CAN",
        ),
        ('BO_ 385 WheelFeedback: 8', "BO_ 385 WheelFeedback: x", "not a valid DBC"),
        (
            'BA_ "E2E_MaxDeltaCounter" BO_ 387 3;',
            'BA_ "E2E_MaxDeltaCounter" BO_ 387 14;',
            "Battery: E2E_MaxDeltaCounter must be 1 to 13",
        ),
    ],
)  # fmt: skip
def test_a_dbc_that_does_not_fit_is_refused_with_file_place_and_nearest_name(
    edited_dbc, old, new, said
):
    path = edited_dbc((old, new))
    message = refusal(path)
    assert str(path) in message
    assert said in message


def test_a_message_may_have_a_29_bit_identifier_and_big_endian_signals(edited_dbc):
    """All lines that name the message by its identifier move with it."""
    path = edited_dbc(
        ("BO_ 387", "BO_ 2147484035"),
        ("SG_ 387", "SG_ 2147484035"),
        ("SG_ BusVoltage : 32|16@1+", "SG_ BusVoltage : 39|16@0+"),
    )
    codec = RobotCodec(load_dbc(path))
    assert codec.dbc.message("Battery").arbitration_id == 387 | EXTENDED_FLAG
    parts = native_parts(codec, NodeParameters(200, 90, 350, sonars=0))
    assert 387 | EXTENDED_FLAG in parts.identifiers("")
    assert 387 not in parts.identifiers("")
    frame = bytes((0, 0, 0, 0, 0x01, 0x02, 0, 0))
    (voltage_v,) = codec.decoder("DriveStatus", "BusVoltage")(frame)
    assert voltage_v == pytest.approx(0x0102 * codec.dbc.signal("DriveStatus", "BusVoltage").scale)


def test_all_errors_of_a_file_are_reported_at_once(edited_dbc):
    path = edited_dbc(
        ('BA_ "E2E_MaxDeltaCounter" BO_ 387 3;', ""),
        ('BA_ "E2E_CrcSignal" BO_ 513 "Crc";', 'BA_ "E2E_CrcSignal" BO_ 513 "Crx";'),
    )
    lines = refusal(path).splitlines()
    assert len(lines) == 2
    assert any("Battery: attribute E2E_MaxDeltaCounter is missing" in line for line in lines)


def test_a_missing_file_is_a_configuration_error(tmp_path):
    assert "cannot be read" in refusal(tmp_path / "none.dbc")
