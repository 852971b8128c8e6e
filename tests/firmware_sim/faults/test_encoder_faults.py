"""Faults of the encoders, in any mixture: what they let the drive read of wheels that turn."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.faults.faulty_parts import REVERSED, SOUND, STUCK, FaultyStage

COUNTS_PER_TURN = 2400
WHEELS = st.integers(0, 1)
TURN = st.tuples(st.just("turn"), st.integers(-500, 500), st.integers(-500, 500))
BREAK = st.tuples(st.just("break"), WHEELS, st.sampled_from((STUCK, REVERSED)))
GLITCH = st.tuples(st.just("glitch"), WHEELS, st.integers(-32000, 32000))
SWAP = st.tuples(st.just("swap"))
END = st.tuples(st.just("end"), st.integers(0, 100))


class Wheel:
    """A wheel that counts what the test says, and what the loop of its drive is told."""

    count = 0
    told = None

    def encoder(self, _counts_per_revolution):
        return self

    def feed_speed_loop(self, axis, factor):
        self.told = axis, factor


class Encoders:
    """Two wheels that turn as they are told, and what is read of them."""

    def __init__(self):
        self.wheels = [Wheel(), Wheel()]
        self.stage = FaultyStage(SimpleNamespace(axes=self.wheels))
        self.sockets = [axis.encoder(COUNTS_PER_TURN) for axis in self.stage.axes]

    def break_encoder(self, wheel, factor):
        return self.stage.axes[wheel].own_encoder.begin(factor)

    @property
    def read(self):
        return [socket.count for socket in self.sockets]

    def turn(self, left, right):
        """Turn the wheels; return what both channels have read of it."""
        before = self.read
        self.wheels[0].count += left
        self.wheels[1].count += right
        return [after - then for after, then in zip(self.read, before, strict=True)]


@pytest.fixture
def encoders():
    return Encoders()


@given(st.lists(st.one_of(TURN, BREAK, GLITCH, SWAP, END), max_size=40))
def test_counts_are_continuous_the_latest_fault_counts_and_in_the_end_the_truth_is_read(steps):
    encoders = Encoders()
    stage = encoders.stage
    present = []  # (wheel or None for a swap, factor, undo), in the order in which they began
    for kind, *what in steps:
        swapped = any(wheel is None for wheel, _, _ in present)
        factors = [SOUND, SOUND]
        for wheel, factor, _ in present:
            if wheel is not None:
                factors[wheel] = factor
        before = encoders.read
        if kind == "turn":
            expected = [factor * turn for factor, turn in zip(factors, what, strict=True)]
            assert encoders.turn(*what) == (expected[::-1] if swapped else expected)
            continue
        if kind == "break":
            present.append((*what, encoders.break_encoder(*what).end))
        elif kind == "swap":
            present.append((None, 0, stage.swap(0, 1)))
        elif kind == "glitch":
            wheel, counts = what
            stage.axes[wheel].own_encoder.jump(counts / COUNTS_PER_TURN)
            before[1 - wheel if swapped else wheel] += counts
        elif present:
            _, _, undo = present.pop(what[0] % len(present))
            undo()
        assert encoders.read == before
    for _, _, undo in present:
        before = encoders.read
        undo()
        assert encoders.read == before
    assert encoders.turn(17, -5) == [17, -5]


def test_of_two_equal_faults_around_another_each_ends_itself(encoders):
    encoders.break_encoder(0, STUCK)
    encoders.break_encoder(0, REVERSED)
    last = encoders.break_encoder(0, STUCK)
    assert encoders.turn(10, 10) == [0, 10]
    last.end()
    assert encoders.turn(10, 10) == [-10, 10]


def test_a_broken_encoder_stays_broken_in_the_other_socket(encoders):
    encoders.break_encoder(0, STUCK)
    encoders.stage.swap(0, 1)
    assert encoders.turn(10, 20) == [20, 0]
