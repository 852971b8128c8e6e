"""The codec against cantools, over random layouts and the published files of ODrive."""

import math
import struct
from pathlib import Path

import cantools.database
import odrive_can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotctl.drivers.can.codec import compile_decoder, compile_encoder
from robotctl.drivers.can.dbc import load_dbc, urgency
from robotctl.errors import ConfigError
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG
from tests.drivers.can.dbc_files import FORMATS, HEAD, layouts

MULTIPLEXED = """BO_ 1 M: 8 HOST
 SG_ K M : 0|8@1+ (1,0) [0|0] "" X
 SG_ A m0 : 8|8@1+ (1,0) [0|0] "" X
"""
ODRIVE = sorted((Path(odrive_can.__file__).parent / "dbc").glob("*.dbc"))


def read(folder, text):
    path = folder / "layout.dbc"
    path.write_text(text)
    return load_dbc(path)


def same(ours, theirs):
    """Equal, nan for nan."""
    return ours == theirs or (ours != ours and theirs != theirs)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("layouts")


@settings(max_examples=120, deadline=None)
@given(layout=layouts(), data=st.data())
def test_frames_of_any_layout_decode_as_with_cantools(folder, layout, data):
    text, can_id, extended, fd = layout
    message = read(folder, text).message("Message")
    oracle = cantools.database.load_string(text, "dbc").get_message_by_name("Message")
    assert message.arbitration_id == (
        can_id | (EXTENDED_FLAG if extended else 0) | (FD_FLAG if fd else 0)
    )
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    names = list(message.signals)
    decode = compile_decoder(message, names)
    expected = oracle.decode(payload, decode_choices=False)
    for name, value in zip(names, decode(payload), strict=True):
        assert same(value, expected[name])
    assert all(map(same, decode(payload + b"\xff"), decode(payload)))
    cut = data.draw(st.integers(0, message.length))
    filled = payload[:cut] + bytes(message.length - cut)
    assert all(map(same, decode(payload[:cut]), decode(filled)))


@settings(max_examples=120, deadline=None)
@given(layout=layouts(), data=st.data())
def test_values_of_any_layout_encode_as_with_cantools(folder, layout, data):
    text, *_ = layout
    message = read(folder, text).message("Message")
    oracle = cantools.database.load_string(text, "dbc").get_message_by_name("Message")
    values = {}
    for signal in message.signals.values():
        if signal.is_float:
            raw = data.draw(st.floats(width=signal.length, allow_nan=False, allow_infinity=False))
            # Scaled, the greatest floats do not fit.
            raw = max(min(raw, 1e30), -1e30)
        else:
            raw = data.draw(st.integers(signal.raw_minimum, signal.raw_maximum))
        plain = signal.scale == 1 and signal.offset == 0
        value = raw if plain else raw * signal.scale + signal.offset
        if not plain and not signal.is_float:
            # Beyond 53 bits a scaled value may round to one that is out of range.
            raw = round((value - signal.offset) / signal.scale)
            if not signal.raw_minimum <= raw <= signal.raw_maximum:
                value = signal.offset
        values[signal.name] = value
    payload = compile_encoder(message, list(values))(*values.values())
    assert payload == oracle.encode(values)


@pytest.mark.parametrize("path", ODRIVE, ids=lambda path: path.stem)
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_the_published_files_of_odrive_read_and_write_as_with_cantools(path, data):
    """The first axis's messages: those of the other seven are the same under other identifiers."""
    dbc, oracle = _odrive(path)
    assert len(dbc.messages) == len(oracle.messages) > 200
    for name, message in dbc.messages.items():
        if not name.startswith("Axis0_"):
            continue
        expected = oracle.get_message_by_name(name)
        assert message.arbitration_id == expected.frame_id
        payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
        decoded = compile_decoder(message, list(message.signals))(payload)
        theirs = expected.decode(payload, decode_choices=False)
        for value, signal in zip(decoded, message.signals, strict=True):
            assert same(value, theirs[signal])
        if message.signals and all(map(math.isfinite, decoded)):
            encode = compile_encoder(message, list(message.signals))
            assert encode(*decoded) == expected.encode(theirs)


_FILES = {}


def _odrive(path):
    """The file for us and for cantools, read once."""
    if path not in _FILES:
        _FILES[path] = load_dbc(path), cantools.database.load_file(path)
    return _FILES[path]


def test_odrive_tells_its_position_in_little_endian_floats():
    """By hand: turns and turns per second of the encoder, two floats of 32 bits."""
    dbc, _ = _odrive(ODRIVE[0])
    message = dbc.message("Axis0_Get_Encoder_Estimates")
    frame = struct.pack("<ff", 1.5, -0.25)
    assert compile_decoder(message, list(message.signals))(frame) == (1.5, -0.25)
    assert compile_encoder(message, list(message.signals))(1.5, -0.25) == frame


def test_a_big_endian_signal_begins_at_its_highest_bit(folder):
    """As VESC packs its status: electrical rpm in four bytes, current in two."""
    text = HEAD + (
        "BO_ 2147486977 Status: 8 DRIVE\n"
        ' SG_ Erpm : 7|32@0- (1,0) [0|0] "rpm" HOST\n'
        ' SG_ Current : 39|16@0- (0.1,0) [0|0] "A" HOST\n'
    )
    message = read(folder, text).message("Status")
    frame = struct.pack(">ihh", -12_345, 123, 0)
    assert message.arbitration_id == 0xD01 | EXTENDED_FLAG
    rpm, current_a = compile_decoder(message, ["Erpm", "Current"])(frame)
    assert (rpm, current_a) == (-12_345, pytest.approx(12.3))
    assert compile_encoder(message, ["Erpm", "Current"])(rpm, current_a) == frame


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e39])
def test_a_float_that_is_no_number_or_too_great_is_refused(folder, value):
    text = HEAD + (
        'BO_ 13 Velocity: 4 HOST\n SG_ Speed : 0|32@1- (1,0) [0|0] "rad/s" DRIVE\n'
        "SIG_VALTYPE_ 13 Speed : 1;\n"
    )
    encode = compile_encoder(read(folder, text).message("Velocity"), ["Speed"])
    assert encode(2.5) == struct.pack("<f", 2.5)
    with pytest.raises(ValueError, match=r"Velocity\.Speed: .* rad/s is out of range"):
        encode(value)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ('BO_ 1 M: 12 HOST\n SG_ A : 0|8@1+ (1,0) [0|0] "" X\n', "12 bytes, a classic frame at"),
        (
            'BO_ 1 M: 9 HOST\n SG_ A : 0|8@1+ (1,0) [0|0] "" X\n'
            + FORMATS
            + 'BA_ "VFrameFormat" BO_ 1 14;\n',
            "M: has 9 bytes, CAN FD allows 0 to 8, 12, 16, 20, 24, 32, 48, 64",
        ),
        (
            'BO_ 1 M: 8 HOST\n SG_ A : 0|16@1- (1,0) [0|0] "" X\nSIG_VALTYPE_ 1 A : 1;\n',
            "M.A: is a float of 16 bits, must have 32 or 64",
        ),
        (
            MULTIPLEXED,
            "M.A: is multiplexed, which is not supported",
        ),
    ],
)
def test_a_layout_that_the_codec_cannot_handle_is_refused_by_name(folder, lines, said):
    with pytest.raises(ConfigError, match=r"layout\.dbc") as refused:
        read(folder, HEAD + lines)
    assert said in str(refused.value)


def test_identifiers_rank_as_their_bits_do():
    ids = [0x0, 0x0 | EXTENDED_FLAG, 0x1, 0x100, 0x100 << 18 | EXTENDED_FLAG, 0x101 | FD_FLAG]
    ids += [0x7FF, 0x1FFFFFFF | EXTENDED_FLAG]
    ranks = [urgency(each) for each in ids]
    assert ranks == sorted(ranks)
    assert len(set(ranks)) == len(ranks)
