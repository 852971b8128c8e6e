"""The firmware's E2E protection against the autosar-e2e package and the rules of profile 1."""

from __future__ import annotations

import pytest
from e2e import p01
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.nodes import e2e
from firmware_sim.nodes.e2e import Checker, CheckStatus, Protector, crc8

DATA_ID = 0xA201
PAYLOADS = st.integers(0, 2**52 - 1).map(lambda bits: bits << 12)
IDS = st.integers(0, 0xFFFF)


def protected(counter, data_id=DATA_ID, payload=b"\x10\x20\x30\x40\x50\x60\x70"):
    data = bytearray(b"\0" + payload)
    data[1] = payload[0] & 0xF0 | counter
    p01.e2e_p01_protect(data, data_id, length=8, increment_counter=False)
    return bytes(data)


def checker_after(counter):
    checker = Checker(DATA_ID)
    assert checker.check(protected(counter)) is CheckStatus.INITIAL
    return checker


def test_the_crc_is_sae_j1850_without_its_inversions():
    # Check value of CRC-8 with polynomial 0x1D, initial value 0, no final xor, of "123456789"
    # ("CRC-8/GSM-A" in the catalogue of parametrised CRC algorithms).
    assert crc8(b"123456789") == 0x37


def test_the_table_is_the_division_of_each_byte_by_the_polynomial():
    def remainder(byte):
        dividend = byte << 8
        for shift in range(7, -1, -1):
            if dividend >> 8 + shift & 1:
                dividend ^= 0x11D << shift
        return dividend

    # Made again, since the one in use was made when the module was loaded.
    assert e2e._table() == tuple(map(remainder, range(256)))


@given(payload=PAYLOADS, data_id=IDS, counter=st.integers(0, 14))
def test_a_protected_frame_is_the_one_autosar_makes(payload, data_id, counter):
    protector = Protector(data_id)
    protector.counter = counter
    expected = bytearray((payload | counter << 8).to_bytes(8, "little"))
    p01.e2e_p01_protect(expected, data_id, length=8, increment_counter=False)
    assert protector.protect(payload) == bytes(expected)


def test_the_sender_counts_from_0_to_14_and_round():
    protector = Protector(DATA_ID)
    assert [protector.protect(0)[1] & 0xF for _ in range(17)] == [*range(15), 0, 1]


@given(payload=PAYLOADS, data_id=IDS, bit=st.integers(0, 63))
def test_every_single_wrong_bit_is_found(payload, data_id, bit):
    data = Protector(data_id).protect(payload)
    corrupt = (int.from_bytes(data, "little") ^ 1 << bit).to_bytes(8, "little")
    checker = Checker(data_id)
    assert checker.check(corrupt) is CheckStatus.WRONG_CRC
    assert checker.crc_rejects == 1
    assert not p01.e2e_p01_check(bytearray(corrupt), data_id, length=8)


@given(payload=PAYLOADS, ours=IDS, other=IDS)
def test_a_masqueraded_frame_is_found_wherever_the_oracle_finds_it(payload, ours, other):
    data = Protector(other).protect(payload)
    accepted = Checker(ours).check(data) is CheckStatus.INITIAL
    assert accepted is p01.e2e_p01_check(bytearray(data), ours, length=8)


def test_the_first_frame_only_sets_the_reference():
    checker = checker_after(7)
    assert checker.check(protected(8)) is CheckStatus.OK


@pytest.mark.parametrize("reference", range(15))
@pytest.mark.parametrize("counter", range(15))
def test_every_step_of_the_counter_is_judged_by_its_size(reference, counter):
    checker = checker_after(reference)
    step = (counter - reference) % 15
    expected = {
        0: CheckStatus.REPEATED,
        1: CheckStatus.OK,
        2: CheckStatus.OK_SOME_LOST,
        3: CheckStatus.OK_SOME_LOST,
    }.get(step, CheckStatus.WRONG_SEQUENCE)
    assert checker.check(protected(counter)) is expected
    assert checker.lost == (step - 1 if step in {2, 3} else 0)
    assert checker.sequence_rejects == (step not in {1, 2, 3})


def test_a_jump_moves_the_reference_so_that_the_next_frame_is_good_again():
    checker = checker_after(0)
    assert checker.check(protected(9)) is CheckStatus.WRONG_SEQUENCE
    assert checker.check(protected(10)) is CheckStatus.OK


def test_a_corrupt_frame_leaves_the_reference():
    checker = checker_after(3)
    assert checker.check(b"\xff" + protected(4)[1:]) is CheckStatus.WRONG_CRC
    assert checker.check(protected(4)) is CheckStatus.OK


def test_the_unused_counter_15_is_never_accepted_and_leaves_the_reference():
    checker = checker_after(14)
    assert checker.check(protected(15)) is CheckStatus.WRONG_SEQUENCE
    assert checker.check(protected(0)) is CheckStatus.OK
    assert checker.check(protected(15)) is CheckStatus.WRONG_SEQUENCE
    assert checker.sequence_rejects == 2
    assert Checker(DATA_ID).check(protected(15)) is CheckStatus.WRONG_SEQUENCE


@pytest.mark.parametrize("length", [*range(8), 9, 64])
def test_a_wrong_length_is_dropped_and_counted(length):
    checker = checker_after(0)
    assert checker.check(bytes(length)) is CheckStatus.WRONG_LENGTH
    assert checker.length_rejects == 1
    assert checker.check(protected(1)) is CheckStatus.OK


def test_every_reject_and_every_loss_is_counted_for_ever():
    checker = checker_after(0)
    for number in range(1, 4):
        checker.check(b"")
        checker.check(b"\xff" + protected(0)[1:])
        # Two lost, a repeat and a jump.
        reference = 8 * (number - 1) % 15
        assert checker.check(protected((reference + 3) % 15)) is CheckStatus.OK_SOME_LOST
        assert checker.check(protected((reference + 3) % 15)) is CheckStatus.REPEATED
        assert checker.check(protected((reference + 8) % 15)) is CheckStatus.WRONG_SEQUENCE
        counts = checker.length_rejects, checker.crc_rejects, checker.lost
        assert counts == (number, number, 2 * number)
        assert checker.sequence_rejects == 2 * number
    checker.reset()
    assert (checker.length_rejects, checker.crc_rejects, checker.lost) == (3, 3, 6)


def test_the_greatest_counter_step_is_1_to_14():
    for max_delta in (1, 14):
        for step in range(2, 15):
            checker = Checker(DATA_ID, max_delta)
            checker.check(protected(0))
            accepted = checker.check(protected(step)) is CheckStatus.OK_SOME_LOST
            assert accepted == (step <= max_delta)


def test_a_sender_that_is_reset_begins_at_0():
    protector = Protector(DATA_ID)
    assert protector.counter == 0
    protector.protect(0)
    protector.reset()
    assert protector.protect(0)[1] & 0xF == 0


def test_after_a_reset_the_next_frame_only_sets_the_reference():
    checker = checker_after(0)
    checker.reset()
    assert checker.check(protected(1)) is CheckStatus.INITIAL


def test_only_good_frames_are_usable():
    assert [status for status in CheckStatus if status.usable] == [
        CheckStatus.OK,
        CheckStatus.OK_SOME_LOST,
    ]


@pytest.mark.parametrize("max_delta", [0, 15, -1])
def test_an_impossible_counter_step_is_refused(max_delta):
    with pytest.raises(ValueError, match="max_delta"):
        Checker(DATA_ID, max_delta)
