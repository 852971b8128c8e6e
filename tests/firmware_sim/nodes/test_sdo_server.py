"""SDO server, byte for byte as CiA 301 figures 24 to 30 draw the transfers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.sdo_server import SdoServer
from firmware_sim.nodes.variables import (
    AbortCode,
    Access,
    DataType,
    Kind,
    Member,
    SdoAbortError,
    compound,
    variable,
)


def make(text="A device name of 29 characters"):
    dictionary = ObjectDictionary(
        [
            variable(0x2000, "byte", DataType.UNSIGNED8, Access.RW, 7, low=2, high=200),
            variable(0x2001, "word", DataType.UNSIGNED16, Access.RO, 0x1234),
            variable(0x2002, "long", DataType.UNSIGNED32, Access.RW, 0xDEADBEEF),
            variable(0x2003, "trigger", DataType.UNSIGNED8, Access.WO, 0),
            variable(0x2004, "text", DataType.VISIBLE_STRING, Access.CONST, text),
            variable(0x2005, "image", DataType.UNSIGNED64, Access.RW, 0x0102030405060708),
            compound(
                0x2006, "array", Kind.ARRAY, [Member("one", DataType.UNSIGNED8, Access.RO, 1)]
            ),
        ]
    )
    return dictionary, SdoServer(dictionary)


def request(command, index, sub_index=0, data=b""):
    return (
        bytes((command,)) + index.to_bytes(2, "little") + bytes((sub_index,)) + data.ljust(4, b"\0")
    )


def abort_code(response):
    assert response[0] == 0x80, response.hex()
    return int.from_bytes(response[4:], "little")


@pytest.mark.parametrize(
    ("index", "response"),
    [
        (0x2000, "4f002000 07000000"),
        (0x2001, "4b012000 34120000"),
        (0x2002, "43022000 efbeadde"),
    ],
)
def test_up_to_four_bytes_are_read_expedited(index, response):
    assert make()[1].respond(request(0x40, index)) == bytes.fromhex(response)


@given(text=st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=40))
def test_longer_values_are_read_in_segments_with_alternating_toggle(text):
    server = make(text)[1]
    response = server.respond(request(0x40, 0x2004))
    if 1 <= len(text) <= 4:
        assert response[0] == 0x43 | (4 - len(text)) << 2
        assert response[4 : 4 + len(text)] == text.encode()
        return
    assert response[:4] == bytes.fromhex("41042000")
    assert int.from_bytes(response[4:], "little") == len(text)
    received, toggle = b"", 0
    while True:
        segment = server.respond(bytes((0x60 | toggle,)) + bytes(7))
        assert segment[0] & 0xF0 == toggle
        received += segment[1 : 8 - (segment[0] >> 1 & 7)]
        if segment[0] & 1:
            break
        toggle ^= 0x10
    assert received == text.encode()
    assert abort_code(server.respond(b"\x60" + bytes(7))) == 0x05040001


@pytest.mark.parametrize("command", [0x2F, 0x22])
def test_a_value_is_written_expedited_with_and_without_size(command):
    dictionary, server = make()
    assert server.respond(request(command, 0x2000, 0, b"\x09")) == request(0x60, 0x2000)
    assert dictionary.number(0x2000) == 9


@pytest.mark.parametrize("initiate", [request(0x21, 0x2005, 0, b"\x08"), request(0x20, 0x2005)])
def test_a_value_is_written_in_segments(initiate):
    dictionary, server = make()
    assert server.respond(initiate) == request(0x60, 0x2005)
    assert server.respond(b"\x00ABCDEFG") == b"\x20" + bytes(7)
    assert dictionary.number(0x2005) == 0x0102030405060708
    assert server.respond(b"\x1dH      ") == b"\x30" + bytes(7)
    assert dictionary.number(0x2005) == int.from_bytes(b"ABCDEFGH", "little")


@pytest.mark.parametrize(
    ("frame", "code"),
    [
        (request(0x40, 0x2FFF), 0x06020000),
        (request(0x40, 0x2006, 2), 0x06090011),
        (request(0x40, 0x2000, 1), 0x06090011),
        (request(0x2F, 0x2FFF, 0, b"\1"), 0x06020000),
        (request(0x2F, 0x2006, 9, b"\1"), 0x06090011),
        (request(0x2B, 0x2001, 0, b"\1\1"), 0x06010002),
        (request(0x21, 0x2004, 0, b"\x08"), 0x06010002),
        (request(0x40, 0x2003), 0x06010001),
        (request(0x2B, 0x2000, 0, b"\3\0"), 0x06070010),
        (request(0x21, 0x2005, 0, b"\x09"), 0x06070010),
        (request(0x2F, 0x2000, 0, b"\1"), 0x06090030),
        (request(0x2F, 0x2000, 0, b"\xc9"), 0x06090030),
        (request(0xA0, 0x2004), 0x05040001),
        (request(0xC0, 0x2005), 0x05040001),
        (request(0xE0, 0x2005), 0x05040001),
        (request(0x60, 0), 0x05040001),
        (request(0x00, 0), 0x05040001),
    ],
)
def test_what_is_refused_and_why(frame, code):
    dictionary, server = make()
    before = [dictionary.number(index) for index in (0x2000, 0x2001, 0x2002, 0x2005)]
    response = server.respond(frame)
    assert abort_code(response) == code
    assert response[1:4] == frame[1:4]
    assert [dictionary.number(index) for index in (0x2000, 0x2001, 0x2002, 0x2005)] == before


def test_a_repeated_toggle_bit_ends_an_upload():
    server = make()[1]
    server.respond(request(0x40, 0x2004))
    server.respond(b"\x60" + bytes(7))
    response = server.respond(b"\x60" + bytes(7))
    assert abort_code(response) == 0x05030000
    assert response[1:4] == bytes.fromhex("042000")
    assert abort_code(server.respond(b"\x70" + bytes(7))) == 0x05040001


def test_a_wrong_first_toggle_bit_ends_a_download():
    server = make()[1]
    server.respond(request(0x21, 0x2005, 0, b"\x08"))
    assert abort_code(server.respond(b"\x10ABCDEFG")) == 0x05030000


def test_segments_beyond_the_size_end_a_download():
    dictionary, server = make()
    server.respond(request(0x20, 0x2005))
    server.respond(b"\x00ABCDEFG")
    assert abort_code(server.respond(b"\x1bHI     ")) == 0x06070010
    assert dictionary.number(0x2005) == 0x0102030405060708


def test_too_few_segments_are_refused_at_the_end():
    server = make()[1]
    server.respond(request(0x20, 0x2005))
    assert abort_code(server.respond(b"\x01ABCDEFG")) == 0x06070010


def test_the_client_may_abort():
    dictionary, server = make()
    server.respond(request(0x21, 0x2005, 0, b"\x08"))
    assert server.respond(request(0x80, 0x2005, 0, b"\0\0\4\5")) is None
    assert abort_code(server.respond(b"\x01ABCDEFG")) == 0x05040001
    assert dictionary.number(0x2005) == 0x0102030405060708


def test_a_new_transfer_replaces_one_under_way():
    server = make()[1]
    server.respond(request(0x40, 0x2004))
    assert server.respond(request(0x40, 0x2000)) == bytes.fromhex("4f002000 07000000")
    assert abort_code(server.respond(b"\x60" + bytes(7))) == 0x05040001


@given(frames=st.lists(st.binary(max_size=8), max_size=12))
def test_no_sequence_of_bytes_upsets_the_server(frames):
    server = make()[1]
    for frame in frames:
        response = server.respond(frame)
        assert response is None or len(response) == 8
    assert server.respond(request(0x40, 0x2001)) == bytes.fromhex("4b012000 34120000")


def test_a_writer_that_refuses_leaves_the_value():
    dictionary, server = make()

    def refuse(_value):
        raise SdoAbortError(AbortCode.DEVICE_STATE)

    dictionary.on_write(0x2000, 0, refuse)
    assert abort_code(server.respond(request(0x2F, 0x2000, 0, b"\x09"))) == 0x08000022
    assert dictionary.number(0x2000) == 7
