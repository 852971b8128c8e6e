"""CAN FD frames bit by bit against a builder that writes them as text, and closed-form lengths."""

import can.util
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bus.bits import INTERMISSION_BITS, checksum, frame_bits
from firmware_sim.bus.fd_bits import (
    CRC17_POLYNOMIAL,
    CRC21_POLYNOMIAL,
    frame_bit_sequence,
    frame_length,
)
from firmware_sim.bus.frame import (
    BIT_RATE_SWITCH_FLAG,
    ERROR_STATE_FLAG,
    EXTENDED_FLAG,
    FD_FLAG,
    FD_LENGTHS,
)

IDS = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF).map(lambda value: value | EXTENDED_FLAG),
)
FLAGS = st.sampled_from(
    [
        FD_FLAG | switch | error_state
        for switch in (0, BIT_RATE_SWITCH_FLAG)
        for error_state in (0, ERROR_STATE_FLAG)
    ]
)
BYTES = st.one_of(
    st.integers(0, 255), st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0x1F, 0xE0, 0x83, 0xC1, 0x3C])
)
FRAMES = st.tuples(
    st.builds(lambda plain, flags: plain | flags, IDS, FLAGS),
    st.sampled_from(FD_LENGTHS).flatmap(
        lambda length: st.lists(BYTES, min_size=length, max_size=length).map(bytes)
    ),
)
STUFF_COUNTS = ("0000", "0011", "0110", "0101", "1100", "1111", "1010", "1001")
"""Gray code and parity of the number of stuff bits modulo 8, as the standard tabulates it."""


def remainder(text, width, polynomial):
    """CRC by long division; a register that begins with 1 inverts the first bit, which is 0."""
    value = int("1" + text[1:], 2) << width
    while value.bit_length() > width:
        value ^= polynomial << (value.bit_length() - width - 1)
    return format(value, f"0{width}b")


def naive_frame(can_id, data):
    """Arbitration phase, data phase and the rest of an acknowledged frame, as text."""
    switch = "1" if can_id & BIT_RATE_SWITCH_FLAG else "0"
    error_state = "1" if can_id & ERROR_STATE_FLAG else "0"
    if can_id & EXTENDED_FLAG:
        plain = format(can_id & 0x1FFFFFFF, "029b")
        head = "0" + plain[:11] + "11" + plain[11:] + "0" + "1" + "0" + switch
    else:
        head = "0" + format(can_id & 0x7FF, "011b") + "0" + "0" + "1" + "0" + switch
    dlc = format(can.util.len2dlc(len(data)), "04b")
    body = head + error_state + dlc + "".join(format(byte, "08b") for byte in data)
    stuffed, switched = "", 0
    for place, bit in enumerate(body):
        if stuffed.endswith(("00000", "11111")):
            stuffed += "1" if stuffed[-1] == "0" else "0"
        stuffed += bit
        if place == len(head) - 1:
            switched = len(stuffed)
    tail = STUFF_COUNTS[(len(stuffed) - len(body)) % 8]
    if len(data) <= 16:
        tail += remainder(stuffed + tail, 17, 0b11_0110_1000_0101_1011)
    else:
        tail += remainder(stuffed + tail, 21, 0b11_0000_0010_1000_1001_1001)
    for start in range(0, len(tail), 4):
        stuffed += "1" if stuffed[-1] == "0" else "0"
        stuffed += tail[start : start + 4]
    stuffed += "1"  # CRC delimiter
    return stuffed[:switched], stuffed[switched:], "0" + "1" + "1" * 7


@given(FRAMES)
def test_the_bits_of_a_frame_are_those_written_out(frame):
    assert "".join(map(str, frame_bit_sequence(*frame))) == "".join(naive_frame(*frame))


@given(FRAMES)
def test_a_frame_is_as_long_as_its_bits_in_either_phase(frame):
    arbitration, data, rest = map(len, naive_frame(*frame))
    length = frame_length(*frame)
    assert length.bits == arbitration + data + rest
    assert length.data_phase == arbitration
    assert length.fast_bits == (data if frame[0] & BIT_RATE_SWITCH_FLAG else 0)


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_a_classic_frame_has_no_fast_bits(can_id, data):
    assert frame_length(can_id, data) == (frame_bits(can_id, data), 0, 0)


def test_crc_check_values_of_the_catalogue():
    bits = [int(bit) for byte in b"123456789" for bit in format(byte, "08b")]
    assert checksum(bits, 17, CRC17_POLYNOMIAL) == 0x04F03  # CRC-17/CAN-FD
    assert checksum(bits, 21, CRC21_POLYNOMIAL) == 0x0ED841  # CRC-21/CAN-FD


@pytest.mark.parametrize("length", FD_LENGTHS)
@pytest.mark.parametrize("extended", [0, EXTENDED_FLAG])
def test_a_frame_without_dynamic_stuff_bits_has_the_bits_that_linux_counts(length, extended):
    """Overhead of linux/can/length.h: 62 or 67 bits, 19 more with a 29-bit id; data on top."""
    can_id = (0x15555555 if extended else 0x555) | extended | FD_FLAG | BIT_RATE_SWITCH_FLAG
    overhead = (62 if length <= 16 else 67) + (19 if extended else 0)
    sent = frame_length(can_id, b"\x55" * length).bits + INTERMISSION_BITS
    assert sent == overhead + 8 * length


@given(FRAMES)
def test_no_frame_is_longer_than_one_stuff_bit_in_four_allows(frame):
    can_id, data = frame
    head = (41 if can_id & EXTENDED_FLAG else 22) + 8 * len(data)
    overhead = 40 if len(data) <= 16 else 45
    length = frame_length(can_id, data).bits + INTERMISSION_BITS
    assert head + overhead <= length <= head + overhead + (head - 1) // 4
