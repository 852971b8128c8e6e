"""Frames of VESC against the firmware's document, and a CRC of another's making."""

from __future__ import annotations

import struct

import pytest
from crccheck.crc import CrcXmodem
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.drives.vesc.buffers import Buffers, frames
from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.vesc import wire
from robotctl.drivers.can.drives.vesc.config import VescMotor, VescServo
from robotctl.drivers.can.drives.vesc.faults import reported_fault
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.messages.ports import EXTENDED_FLAG
from robotctl.safety.state_machine import SafetyConfig

PACKETS = st.binary(min_size=1, max_size=512)


def test_the_documents_example_of_a_command() -> None:
    assert wire.identifier(wire.SET_CURRENT, 23) == EXTENDED_FLAG | 0x0117
    assert wire.pack_value(51 * 1000) == bytes.fromhex("0000C738")


def test_status_messages_as_the_document_lays_them_out() -> None:
    # B0-B3 ERPM, B4-B5 current x 10, B6-B7 duty x 1000; big-endian.
    assert wire.STATUS_DATA.unpack(bytes.fromhex("FFFFD8F0 FF9C 01F4")) == (-10_000, -100, 500)
    # B0-B1 FET x 10, B2-B3 motor x 10, B4-B5 current in x 10, B6-B7 position x 50.
    assert wire.STATUS_4_DATA.unpack(bytes.fromhex("00FA 01C2 FFF6 4650")) == (
        250,
        450,
        -10,
        18_000,
    )
    # B0-B3 tachometer, B4-B5 volts x 10.
    assert wire.SHORT_STATUS_5_DATA.unpack(bytes.fromhex("00000258 00F0")) == (600, 240)
    assert wire.STATUS_5_DATA.unpack(bytes.fromhex("FFFFFDA8 00F0 0000")) == (-600, 240, 0)


@given(PACKETS)
def test_a_packet_of_the_host_arrives_whole(packet: bytes) -> None:
    sent = wire.to_frames(packet, 5, 133)
    assert all(1 <= len(data) <= 8 for _, data in sent)
    if len(packet) <= 6:
        assert sent == ((EXTENDED_FLAG | 8 << 8 | 5, bytes((133, 0)) + packet),)
        return
    buffers = Buffers()
    for identifier, data in sent[:-1]:
        command = identifier >> 8 & 0xFF
        assert identifier & 0xFF == 5
        head = 1 if command == 5 else 2
        assert command == (5 if int.from_bytes(data[:head], "big") < 256 and head == 1 else 6)
        buffers.fill(int.from_bytes(data[:head], "big"), data[head:])
    reply_to, how, length, crc = struct.unpack(">BBHH", sent[-1][1])
    assert sent[-1][0] == EXTENDED_FLAG | 7 << 8 | 5
    assert (reply_to, how, length, crc) == (133, 0, len(packet), CrcXmodem.calc(packet))
    assert buffers.take(length, crc) == packet


@given(PACKETS, st.integers(0, 80), st.booleans())
def test_an_answer_arrives_whole_or_not_at_all(packet: bytes, place: int, damage: bool) -> None:
    taken: list[bytes] = []
    assembly = wire.Reassembly(5, lambda data, _: taken.append(data))
    takers = {
        5: assembly.on_fill,
        6: assembly.on_fill_long,
        7: assembly.on_process,
        8: assembly.on_short,
    }
    answer = list(frames(packet, 5))
    lost = damage and len(answer) > 1
    if lost:
        del answer[place % len(answer)]
    for command, data in answer:
        takers[command](data, 0)
    assert taken == ([] if lost else [packet])
    for command, data in frames(packet, 5):
        takers[command](data, 0)
    assert taken[-1:] == [packet], "the next one arrives again"


def test_answers_of_another_vesc_are_not_taken() -> None:
    taken: list[bytes] = []
    assembly = wire.Reassembly(5, lambda data, _: taken.append(data))
    for command, data in frames(b"1234567", 6):
        {5: assembly.on_fill, 7: assembly.on_process}[command](data, 0)
    assembly.on_short(bytes((6, 1)) + b"12", 0)
    assert taken == []


def test_faults_and_flags_are_asked_for_in_one_frame() -> None:
    identifier, data = wire.query(5, 133)
    assert identifier == EXTENDED_FLAG | 8 << 8 | 5
    assert data == bytes((133, 0, 50)) + struct.pack(">I", 1 << 15 | 1 << 21)
    head = data[2:]
    assert wire.unpack_report(head + b"\x04") == (4, None, None)
    assert wire.unpack_report(head + b"\x00\x03") == (0, True, True)
    assert wire.unpack_report(head + b"\x00\x02") == (0, False, True)
    assert wire.unpack_report(b"\x32" + bytes(5)) is None


@pytest.mark.parametrize(("position", "data"), [(0, "85020C0000"), (1000, "85020C03E8")])
def test_the_servo_is_moved_by_a_packet_that_wants_no_answer(position: int, data: str) -> None:
    assert wire.pack_servo(0x85, position) == bytes.fromhex(data)


def test_every_code_of_the_firmware_has_words() -> None:
    texts = {reported_fault(code, "motor").text for code in range(1, 30)}
    assert len(texts) == 29
    assert reported_fault(99, "motor").code is FaultCode.DRIVE_FAULT


def table(**options: object) -> VescMotor:
    axes = (AxisConfig("drive"), AxisConfig("steering", 2))
    return VescMotor("vesc", "motor", axes, **{"brake_current_a": 5.0, **options})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"node_id": 255}, "node_id must be 0 to 254, not 255"),
        ({"pole_pairs": 0}, "pole_pairs must be 1 to 100, not 0"),
        ({"status_rate_hz": 5}, "status_rate_hz must be 50 to 1000, not 5"),
        ({"brake_current_a": -1.0}, "brake_current_a must be 0 to 1000, not -1"),
        ({"brake_current_a": float("nan")}, "brake_current_a must be 0 to 1000, not nan"),
        ({"brake_current_a": 0.0}, "accept_coasting = true"),
        ({"accept_timeout_ms": -1}, "accept_timeout_ms must be 0 to 60000"),
    ],
)
def test_a_wrong_table_is_refused_with_what_is_allowed(
    options: dict[str, object], words: str
) -> None:
    with pytest.raises(InvalidValue, match=words):
        table(**options)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"centre": 1.0}, "between 0 and 1, not 1"), ({"range_deg": 0.0}, "above 0, at most 360")],
)
def test_a_wrong_servo_is_refused(options: dict[str, float], words: str) -> None:
    with pytest.raises(InvalidValue, match=words):
        VescServo(**options)


def test_the_axes_are_a_motor_and_perhaps_a_servo() -> None:
    with pytest.raises(InvalidValue, match=r"axis 1 \(motor\), or 1 and 2 \(servo\), not \[2\]"):
        VescMotor("vesc", "motor", (AxisConfig("steering", 2),), brake_current_a=1.0)


def test_answers_go_to_a_number_that_no_other_vesc_has() -> None:
    numbers = [table(node_id=number).node_ids for number in range(255)]
    assert all(own != reply and 0 <= reply <= 254 for own, reply in numbers)
    assert len({reply for _, reply in numbers}) == 255


def test_whether_it_brakes_depends_on_its_current() -> None:
    assert table().abilities.brakes
    assert not table(brake_current_a=0.0, accept_coasting=True).abilities.brakes


def test_ages_follow_the_rate_of_status() -> None:
    ages = {age.field: age for age in table(status_rate_hz=50).ages(SafetyConfig(), 5_000_000)}
    assert ages["motion"].limit_ns == 3 * 20_000_000
    assert ages["report"].limit_ns == 200_000_000
    fast = {age.field: age for age in table(status_rate_hz=500).ages(SafetyConfig(), 5_000_000)}
    assert fast["motion"].limit_ns == 15_000_000
