"""Frame lengths, CRC and arbitration keys against a builder that writes every bit as text."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.bus.bits import (
    INTERMISSION_BITS,
    arbitration_key,
    classic_bit_sequence,
    crc15,
    frame_bits,
)
from firmware_sim.bus.frame import EXTENDED_FLAG, REMOTE_FLAG

IDS = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF).map(lambda value: value | EXTENDED_FLAG),
)
FRAMES = st.tuples(
    st.builds(lambda plain, remote: plain | (REMOTE_FLAG if remote else 0), IDS, st.booleans()),
    st.one_of(
        st.binary(max_size=8),
        st.lists(st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0xC1, 0x83]), max_size=8).map(bytes),
    ),
)


def arbitration_text(can_id):
    """Arbitration field and IDE as the standard draws them, most significant bit first."""
    remote = "1" if can_id & REMOTE_FLAG else "0"
    if can_id & EXTENDED_FLAG:
        text = format(can_id & 0x1FFFFFFF, "029b")
        return text[:11] + "1" + "1" + text[11:] + remote
    return format(can_id & 0x7FF, "011b") + remote + "0"


def naive_frame(can_id, data):
    """All bits of an acknowledged frame, stuffed, by textbook division and run counting."""
    remote = bool(can_id & REMOTE_FLAG)
    reserved = "00" if can_id & EXTENDED_FLAG else "0"
    text = "0" + arbitration_text(can_id) + reserved + format(len(data), "04b")
    if not remote:
        text += "".join(format(byte, "08b") for byte in data)
    remainder = int(text, 2) << 15
    polynomial = 0b1100010110011001
    while remainder.bit_length() > 15:
        remainder ^= polynomial << (remainder.bit_length() - 16)
    text += format(remainder, "015b")
    stuffed = ""
    for bit in text:
        stuffed += bit
        if stuffed.endswith(("00000", "11111")):
            stuffed += "1" if bit == "0" else "0"
    return stuffed + "1" + "0" + "1" + "1" * 7


@given(FRAMES)
def test_a_frame_is_as_long_as_its_bits_written_out(frame):
    assert frame_bits(*frame) == len(naive_frame(*frame))


@given(FRAMES)
def test_the_bits_themselves_are_the_same(frame):
    assert "".join(map(str, classic_bit_sequence(*frame))) == naive_frame(*frame)


def test_every_identifier_without_data_has_its_length():
    for plain in range(0x800):
        assert frame_bits(plain, b"") == len(naive_frame(plain, b""))


def test_crc_check_value_of_the_catalogue():
    bits = [int(bit) for byte in b"123456789" for bit in format(byte, "08b")]
    assert crc15(bits) == 0x059E  # CRC-15/CAN


@given(FRAMES)
def test_no_frame_is_longer_than_the_published_worst_case(frame):
    """8 n + g + 13 + floor((g + 8 n - 1) / 4), g = 34 or 54 (Davis, Burns, Bril, Lukkien 2007)."""
    can_id, data = frame
    header = 54 if can_id & EXTENDED_FLAG else 34
    size = 0 if can_id & REMOTE_FLAG else 8 * len(data)
    worst = size + header + 13 + (header + size - 1) // 4
    length = frame_bits(can_id, data) + INTERMISSION_BITS
    assert size + header + 13 <= length <= worst


def test_worst_case_of_eight_bytes_is_135_bits_and_nearly_reached():
    data = bytes.fromhex("3C3C3C3C3C3C3C3C")
    longest = max(frame_bits(plain, data) + 3 for plain in range(0x800))
    assert 129 <= longest <= 135


def test_the_frame_of_only_dominant_bits_has_one_stuff_bit_in_five():
    """34 zeros, as the CRC of zeros is 0: 6 stuff bits, and 10 bits of trailer."""
    assert frame_bits(0, b"") == 34 + 6 + 10


@given(IDS, IDS, st.booleans(), st.booleans())
def test_the_lower_key_is_the_one_with_the_first_dominant_bit(first, second, remote1, remote2):
    first |= REMOTE_FLAG if remote1 else 0
    second |= REMOTE_FLAG if remote2 else 0
    a, b = arbitration_text(first), arbitration_text(second)
    width = min(len(a), len(b))
    # What one has to send while it still competes decides; equal prefixes cannot differ in length.
    if a[:width] == b[:width]:
        assert first == second
    else:
        assert (arbitration_key(first) < arbitration_key(second)) == (a[:width] < b[:width])
