"""Frames of moteus against its maker's package, both ways, and against its documents."""

from __future__ import annotations

import math
import struct

import moteus
import pytest
from hypothesis import given
from hypothesis import strategies as st
from moteus import multiplex, protocol
from moteus.protocol import Register

from robotctl.drivers.can.drives.axis import AxisConfig
from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.moteus.config import MoteusMotor
from robotctl.drivers.can.drives.moteus.faults import reported_fault
from robotctl.errors import InvalidValue
from robotctl.messages.faults import FaultCode
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, FD_LENGTHS


class Query(moteus.QueryResolution):
    """What the host asks for, in the words of the package."""

    torque = multiplex.IGNORE
    q_current = multiplex.INT16
    voltage = temperature = fault = multiplex.INT16
    _extra = {Register.MILLISECOND_COUNTER: multiplex.INT32}  # noqa: RUF012 - as the package has it


PEER = moteus.Controller(1, query_resolution=Query(), transport=object())


def filled(data: bytes) -> bytes:
    """Return a frame as the package's transport fills it up."""
    length = next(each for each in FD_LENGTHS if each >= len(data))
    return data + bytes([0x50]) * (length - len(data))


@given(st.floats(-1e4, 1e4, width=32), st.sampled_from([0.05, 0.09, 0.5]))
def test_a_velocity_is_the_bytes_of_the_package(turns_s: float, watchdog_s: float) -> None:
    theirs = PEER.make_position(
        position=math.nan, velocity=turns_s, watchdog_timeout=watchdog_s, query=True
    )
    assert wire.pack_velocity(turns_s, watchdog_s) == filled(theirs.data)
    assert theirs.reply_required


def test_stop_brake_query_and_stream_are_the_bytes_of_the_package() -> None:
    for ours, theirs in (
        (wire.pack_mode(wire.STOPPED), PEER.make_stop(query=True)),
        (wire.pack_mode(wire.BRAKE), PEER.make_brake(query=True)),
        (wire.pack_query(), PEER.make_query()),
        (wire.pack_poll(), PEER.make_diagnostic_read(48)),
        (wire.pack_text("conf get a.b"), PEER.make_diagnostic_write(b"conf get a.b\n")),
        (
            wire.pack_read_versions(),
            PEER.make_custom_query(
                {Register.FIRMWARE_VERSION: multiplex.INT32, Register.REGISTER_MAP_VERSION: 2}
            ),
        ),
    ):
        assert ours == filled(theirs.data)


def test_identifiers_are_those_of_the_documents() -> None:
    assert wire.command_id(1) == FD_FLAG | EXTENDED_FLAG | 0x8001
    assert wire.command_id(1, answered=False) == FD_FLAG | 0x001
    assert wire.answer_ids(10) == (FD_FLAG | EXTENDED_FLAG | 0xA00,)
    assert set(wire.answer_ids(1)) == {FD_FLAG | 0x100, FD_FLAG | EXTENDED_FLAG | 0x100}


STATUS = st.tuples(
    st.integers(0, 15),
    st.floats(width=32),
    st.floats(width=32),
    st.integers(-32767, 32767),
    st.integers(0, 600),
    st.integers(-400, 1500),
    st.integers(0, 110),
    st.integers(0, (1 << 32) - 1),
)


@given(STATUS)
def test_an_answer_is_read_as_the_package_reads_it(values) -> None:
    mode, position, velocity, current, supply, temperature, fault, counter = values
    data = (
        bytes((0x21, 0x00, mode, 0x2E, 0x01))
        + struct.pack("<ff", position, velocity)
        + struct.pack("<BBh", 0x25, 0x04, current)
        + struct.pack("<BBhhh", 0x27, 0x0D, supply, temperature, fault)
        + struct.pack("<BBI", 0x29, 0x70, counter)
    )
    ours = wire.unpack_status(filled(data))
    theirs = protocol.parse_reply(filled(data))
    assert ours is not None
    units = (1, 1, 1, wire.AMPERES, wire.VOLTS, wire.DEGREES, 1, 1)
    keys = (
        Register.MODE,
        Register.POSITION,
        Register.VELOCITY,
        Register.Q_CURRENT,
        Register.VOLTAGE,
        Register.TEMPERATURE,
        Register.FAULT,
    )
    for value, unit, key in zip(ours, units, keys, strict=False):
        assert value * unit == pytest.approx(theirs[key], nan_ok=True)
    assert ours[7] == theirs[Register.MILLISECOND_COUNTER] % (1 << 32)


@given(st.binary(max_size=64))
def test_no_other_frame_is_taken_for_a_status(data: bytes) -> None:
    if wire.unpack_status(data) is not None:
        assert data[:2] == b"\x21\x00"
    wire.unpack_text(data)
    wire.unpack_versions(data)


def test_versions_are_read() -> None:
    answer = bytes.fromhex("2a8102 09010000 05000000")
    assert wire.unpack_versions(answer) == (0x109, 5)
    assert protocol.parse_reply(answer) == {0x101: 0x109, 0x102: 5}
    assert wire.unpack_versions(answer[:-1]) is None


def test_every_documented_fault_has_words() -> None:
    texts = {reported_fault(code, "m").text for code in range(32, 49)}
    assert len(texts) == 17
    assert not any("not known" in text for text in texts)
    assert reported_fault(34, "m").code is FaultCode.DRIVE_OVER_VOLTAGE
    assert "not known" in reported_fault(49, "m").text


@pytest.mark.parametrize("number", [0, 127])
def test_a_number_that_no_drive_can_have_is_refused(number: int) -> None:
    with pytest.raises(InvalidValue, match=f"node_id must be 1 to 126, not {number}"):
        MoteusMotor("moteus", "left", (AxisConfig("left"),), node_id=number)


def test_it_has_one_axis() -> None:
    with pytest.raises(InvalidValue, match=r"axes must be axis 1 alone, not \[1, 2\]"):
        MoteusMotor("moteus", "left", (AxisConfig("left"), AxisConfig("right", 2)))
