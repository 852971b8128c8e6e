import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotctl.drivers.can.nodes.sdo import RETRIES, TIMEOUT_NS, Request, SdoClient, SdoResponse

READ = Request(0x1018, 1, "vendor")
WRITE = Request(0x2000, 0, "command time-out", value=100, size=2)


def started(request, now_ns=0):
    client = SdoClient()
    client.start(request)
    assert client.poll(now_ns) is not None
    client.sent(now_ns)
    return client


def answer(command, index=0x1018, subindex=1, value=0):
    return struct.pack("<BHBI", command, index, subindex, value)


def test_requests_are_those_of_cia_301():
    assert READ.frame() == bytes.fromhex("4018100100000000")
    assert WRITE.frame() == bytes.fromhex("2b00200064000000")
    assert Request(0x2010, 0, "", value=1, size=1).frame() == bytes.fromhex("2f10200001000000")
    assert Request(0x1, 0, "", value=7, size=4).frame() == bytes.fromhex("2301000007000000")


@given(st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_an_expedited_answer_is_read_with_its_size(size, value):
    client = started(READ)
    response = client.receive(answer(0x43 | (4 - size) << 2, value=value))
    assert response == SdoResponse(value=value & (1 << 8 * size) - 1)
    assert client.idle


def test_an_answer_without_size_has_four_bytes():
    assert started(READ).receive(answer(0x42, value=0x01020304)) == SdoResponse(value=0x01020304)


def test_a_write_ends_with_its_confirmation():
    assert started(WRITE).receive(answer(0x60, 0x2000, 0)) == SdoResponse(value=0)


def test_an_abort_ends_the_transfer_with_its_code():
    response = started(WRITE).receive(answer(0x80, 0x2000, 0, 0x06090030))
    assert response == SdoResponse(abort=0x06090030)


@pytest.mark.parametrize(
    "frame",
    [
        answer(0x43, index=0x1019),
        answer(0x43, subindex=2),
        answer(0x60),
        answer(0x41),
        answer(0x43)[:7],
        b"",
        answer(0x80, subindex=2),
    ],
)
def test_what_is_no_answer_to_the_request_is_ignored(frame):
    client = started(READ)
    assert client.receive(frame) is None
    assert not client.idle
    assert client.receive(answer(0x43, value=5)) == SdoResponse(value=5)


def test_an_answer_to_nothing_is_ignored():
    client = SdoClient()
    assert client.receive(answer(0x43)) is None
    client.start(READ)
    assert client.receive(answer(0x43)) is None


def test_a_request_is_repeated_after_its_time_and_given_up_in_the_end():
    client = SdoClient()
    client.start(READ)
    sent_ns = []
    for now_ns in range(0, 10 * TIMEOUT_NS, TIMEOUT_NS // 10):
        if client.expired(now_ns):
            break
        if client.poll(now_ns) is not None:
            client.sent(now_ns)
            sent_ns.append(now_ns)
    assert sent_ns == [n * TIMEOUT_NS for n in range(RETRIES + 1)]
    assert now_ns == (RETRIES + 1) * TIMEOUT_NS
    assert client.idle


def test_a_frame_that_the_bus_did_not_take_is_offered_again_and_is_no_attempt():
    client = SdoClient()
    client.start(READ)
    for now_ns in range(100):
        assert client.poll(now_ns) == READ.frame()
        assert not client.expired(now_ns)


def test_a_cancelled_transfer_takes_no_answer():
    client = started(READ)
    client.cancel()
    assert client.receive(answer(0x43)) is None
    assert client.poll(10**9) is None


def test_a_request_reads_as_a_person_would_say_it():
    assert str(READ) == "read of 0x1018:01 (vendor)"
    assert str(WRITE) == "write of 0x2000:00 (command time-out)"
