"""Give both receivers of end-to-end protection bad frames by the million, and count what passes.

The first table makes bad frames by itself, one class after another; the second lets the fault
injector of the simulated bus make them. Some classes profile 1 rejects by construction; of the
others it lets a known share through, which is printed beside what was found. Exit status 1 where a
frame of the first sort was accepted, or a share is further from theory than chance allows.

The polynomial 0x11D is primitive: its CRC finds all errors of one and two bits in frames up to 255
bits, and as every CRC of 8 bits all bursts up to that length. The counter accepts steps 1 to 3
of 15.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firmware_sim.bus.core import Bus
from firmware_sim.bus.faults import Corrupt, Delay, Duplicate, FrameFault, Reorder, Stale
from firmware_sim.bus.frame import Frame
from firmware_sim.nodes import wire
from firmware_sim.nodes.e2e import COUNTER_MODULUS, Checker, crc8, data_id_crc
from robotctl.drivers.can.dbc import Dbc, load_dbc
from robotctl.drivers.can.e2e import E2eCounters, E2eReceiver

DBC = Path(__file__).parents[1] / "configs" / "robot.dbc"
FEEDBACK, COMMAND = wire.WHEEL_FEEDBACK, wire.MOTOR_COMMAND
MAX_DELTA = 3
PERIOD_NS = 5_000_000
SIGMAS = 5.0
COUNTER_BITS = range(8, 12)
"""Of a frame as a little-endian integer."""


class Host:
    """The host's receiver of wheel feedback."""

    name, identifier = "host", FEEDBACK

    def __init__(self, dbc: Dbc) -> None:
        message = dbc.message("WheelFeedback")
        self._receiver = E2eReceiver(message, PERIOD_NS, E2eCounters())
        self._stamp_ns = 0
        self.reset = self._receiver.reset

    def accept(self, data: bytes) -> bool:
        """Judge a frame that comes one period after the one before it."""
        self._stamp_ns += PERIOD_NS
        return self._receiver.accept(data, self._stamp_ns)


class Firmware:
    """The drive's receiver of motor commands."""

    name, identifier = "firmware", COMMAND

    def __init__(self) -> None:
        self._checker = Checker(wire.data_id(COMMAND), MAX_DELTA)
        self.reset = self._checker.reset

    def accept(self, data: bytes) -> bool:
        """Judge a frame."""
        return self._checker.check(data).usable


Receiver = Host | Firmware


@dataclass(frozen=True)
class Row:
    """What became of one class of bad frames at one receiver; no share: nothing is promised."""

    name: str
    receiver: str
    frames: int
    accepted: int
    share: float | None

    @property
    def right(self) -> bool:
        """Whether that is what theory says, within `SIGMAS` standard deviations."""
        if self.share is None:
            return True
        if self.share == 0.0:
            return self.accepted == 0
        spread = math.sqrt(self.frames * self.share * (1.0 - self.share))
        return abs(self.accepted - self.frames * self.share) <= SIGMAS * spread


def protected(data_id_start: int, counter: int, body: bytes) -> bytes:
    """Return a frame with its CRC; `body` is bytes 1 to 7, its low nibble for the counter."""
    body = bytes((body[0] & 0xF0 | counter,)) + body[1:]
    return bytes((crc8(body, data_id_start),)) + body


class Maker:
    """Makes bad frames for one receiver, which has just taken a frame with a given counter.

    Parameters
    ----------
    identifier
        Of the frame.
    rng
        Of counters, payloads and errors.
    """

    def __init__(self, identifier: int, rng: np.random.Generator) -> None:
        self._start = data_id_crc(wire.data_id(identifier))
        drive = (COMMAND, FEEDBACK, wire.MOTOR_STATUS, wire.DRIVE_STATUS)
        others = (*drive, *wire.SONAR_RANGES, wire.BATTERY)
        self._others = [data_id_crc(wire.data_id(each)) for each in others if each != identifier]
        self._draw = rng.integers
        self._bytes = rng.bytes

    def good(self, counter: int) -> bytes:
        """Return a good frame with a random payload."""
        return protected(self._start, counter % COUNTER_MODULUS, self._bytes(7))

    def flipped(self, counter: int, bits: int) -> bytes:
        """Return the next frame with so many wrong bits."""
        word = int.from_bytes(self.good(counter + 1), "little")
        chosen: set[int] = set()
        while len(chosen) < bits:
            chosen.add(int(self._draw(64)))
        for bit in chosen:
            word ^= 1 << bit
        return word.to_bytes(8, "little")

    def burst(self, counter: int) -> bytes:
        """Return the next frame with a burst of 2 to 8 bits, in their order on the wire."""
        length = int(self._draw(2, 9))
        pattern = 1 | 1 << length - 1 | int(self._draw(1 << length))
        word = int.from_bytes(self.good(counter + 1), "big")
        word ^= pattern << int(self._draw(56 - length + 1))
        return word.to_bytes(8, "big")

    def wrong_crc(self, counter: int) -> bytes:
        """Return the next frame with another CRC."""
        data = self.good(counter + 1)
        return bytes((data[0] ^ int(self._draw(1, 256)),)) + data[1:]

    def jumped(self, counter: int) -> bytes:
        """Return a good frame whose counter has jumped."""
        return self.good(counter + int(self._draw(MAX_DELTA + 1, COUNTER_MODULUS)))

    def counter_15(self, _: int) -> bytes:
        """Return a frame with the counter that no sender uses."""
        return protected(self._start, 15, self._bytes(7))

    def foreign(self, counter: int) -> bytes:
        """Return the next frame as the sender of another of our frames would protect it."""
        start = self._others[int(self._draw(len(self._others)))]
        return protected(start, (counter + 1) % COUNTER_MODULUS, self._bytes(7))

    def anonymous(self, counter: int) -> bytes:
        """Return the next frame with a CRC that knows no data id."""
        return protected(0, (counter + 1) % COUNTER_MODULUS, self._bytes(7))

    def short(self, counter: int) -> bytes:
        """Return the next frame cut off."""
        return self.good(counter + 1)[: int(self._draw(8))]

    def stale(self, counter: int, oldest: int) -> bytes:
        """Return a good frame of so many frames ago at most; 0 is the one just taken."""
        return self.good(counter - int(self._draw(oldest + 1)))

    def garbage(self, _: int) -> bytes:
        """Return eight random bytes."""
        return self._bytes(8)


CERTAIN: dict[str, Callable[[Maker, int], bytes]] = {
    "one bit wrong": lambda maker, counter: maker.flipped(counter, 1),
    "two bits wrong": lambda maker, counter: maker.flipped(counter, 2),
    "burst of 2 to 8 bits, bytes 1 to 7": Maker.burst,
    "wrong CRC": Maker.wrong_crc,
    "repeated": lambda maker, counter: maker.stale(counter, 0),
    "counter jumped by 4 to 14": Maker.jumped,
    "counter 15": Maker.counter_15,
    "stale by 0 to 11 frames": lambda maker, counter: maker.stale(counter, 11),
    "masquerade: another frame's data id": Maker.foreign,
    "masquerade: no data id": Maker.anonymous,
    "too short": Maker.short,
}
"""What profile 1 rejects by construction."""

STATISTICAL: dict[str, Callable[[Maker, int], bytes]] = {
    "three bits wrong": lambda maker, counter: maker.flipped(counter, 3),
    "random bytes": Maker.garbage,
    "stale by 0 to 14 frames": lambda maker, counter: maker.stale(counter, 14),
}


def shares() -> dict[str, float]:
    """Return the share of each statistical class that is accepted in theory."""
    steps = MAX_DELTA / COUNTER_MODULUS
    return {
        "three bits wrong": _three_bits(),
        "random bytes": 1 / 256 * MAX_DELTA / 16,
        "stale by 0 to 14 frames": steps,
    }


def _three_bits() -> float:
    """Count the errors of three bits that the CRC does not see and the counter takes."""
    syndromes = []
    for bit in range(64):
        data = (1 << bit).to_bytes(8, "little")
        syndromes.append(crc8(data[1:]) ^ data[0])
    passed = 0.0
    for bits in itertools.combinations(range(64), 3):
        first, second, third = (syndromes[bit] for bit in bits)
        if first ^ second ^ third == 0:
            passed += _counter_passes([bit - 8 for bit in bits if bit in COUNTER_BITS])
    return passed / math.comb(64, 3)


def _counter_passes(flips: list[int]) -> float:
    """Return how many of the 15 counters are still taken for the next with some bits flipped."""
    taken = 0
    for counter in range(COUNTER_MODULUS):
        read = counter
        for bit in flips:
            read ^= 1 << bit
        step = (read - counter + 1) % COUNTER_MODULUS
        taken += read < COUNTER_MODULUS and 1 <= step <= MAX_DELTA
    return taken / COUNTER_MODULUS


def judge_made(frames: int, seed: int) -> Iterator[Row]:
    """Give each receiver so many frames of each class, each after a good one."""
    theory = shares()
    receivers: tuple[Receiver, ...] = (Host(load_dbc(DBC)), Firmware())
    for (name, make), receiver in itertools.product({**CERTAIN, **STATISTICAL}.items(), receivers):
        rng = np.random.default_rng([seed, receiver.identifier])
        maker = Maker(receiver.identifier, rng)
        accepted = 0
        for counter in rng.integers(COUNTER_MODULUS, size=frames).tolist():
            receiver.reset()
            receiver.accept(maker.good(counter))
            accepted += receiver.accept(make(maker, counter))
        yield Row(name, receiver.name, frames, accepted, theory.get(name, 0.0))


class Listener:
    """A receiver on the bus that knows which frames were truly sent, and when.

    A frame is bad if nobody sent it so, or if a newer one has come before it.
    """

    def __init__(self, receiver: Receiver) -> None:
        self.receiver = receiver
        self.numbers: dict[bytes, int] = {}
        self.newest = -1
        self.bad = self.accepted = 0

    def take(self, frame: Frame) -> None:
        """Judge a frame."""
        usable = self.receiver.accept(frame.data)
        number = self.numbers.get(frame.data, -1)
        if number <= self.newest:
            self.bad += 1
            self.accepted += usable
        else:
            self.newest = number


INJECTED: dict[str, tuple[Callable[[int], FrameFault] | None, float | None]] = {
    "injector: corrupt": (lambda i: Corrupt(arbitration_id=i, probability=0.5), 0.0),
    "injector: repeated": (lambda i: Duplicate(arbitration_id=i, probability=0.5), 0.0),
    "injector: stale": (lambda i: Stale(arbitration_id=i, probability=0.5), 0.0),
    "injector: reordered": (lambda i: Reorder(arbitration_id=i, probability=0.5), 0.0),
    "injector: masquerade, no data id": (None, 0.0),
    "injector: 30 % are 2.5 periods late": (
        lambda i: Delay(arbitration_id=i, probability=0.3, delay_ns=5 * PERIOD_NS // 2),
        None,
    ),
}


def judge_injected(frames: int, seed: int) -> Iterator[Row]:
    """Let the injector make bad frames until each receiver has had so many of each class."""
    dbc = load_dbc(DBC)
    makers: tuple[Callable[[], Receiver], ...] = (lambda: Host(dbc), Firmware)
    for (name, (fault, share)), make in itertools.product(INJECTED.items(), makers):
        listener = Listener(make())
        _run_bus(listener, fault, frames, seed)
        yield Row(name, listener.receiver.name, listener.bad, listener.accepted, share)


def _run_bus(
    listener: Listener, fault: Callable[[int], FrameFault] | None, frames: int, seed: int
) -> None:
    identifier = listener.receiver.identifier
    bus = Bus(seed=seed)
    sender = bus.attach("sender", lambda _: None, accept=())
    other = bus.attach("other", lambda _: None, accept=())
    bus.attach("receiver", listener.take)
    if fault is not None:
        bus.inject(fault(identifier))
    start = data_id_crc(wire.data_id(identifier))
    number = 0
    while listener.bad < frames:
        body = bytes((number & 0xF0,)) + number.to_bytes(6, "little")
        data = protected(start, number % COUNTER_MODULUS, body)
        listener.numbers[data] = number
        sender.send(identifier, data)
        number += 1
        if fault is None:
            bus.advance(bus.now_ns + PERIOD_NS // 2)
            other.send(identifier, protected(0, number % COUNTER_MODULUS, body))
        bus.advance(number * PERIOD_NS)


def show(row: Row) -> str:
    """Return a row of the printed table."""
    found = row.accepted / row.frames if row.frames else 0.0
    if row.share is None:
        theory = "no promise"
    elif row.share == 0.0:
        theory = "none, by construction"
    else:
        theory = f"{100 * row.share:.4f} %"
    verdict = "" if row.right else "  WRONG"
    return (
        f"{row.name:38} {row.receiver:9} {row.frames:9} {row.frames - row.accepted:9} "
        f"{row.accepted:8} {100 * found:9.4f} %  {theory}{verdict}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run all classes and print them; 1 where something is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=50_000, help="of each class and receiver")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    began_s = time.monotonic()
    print(f"{'class':38} {'receiver':9} {'bad':>9} {'rejected':>9} {'accepted':>8}  "
          f"{'share':>9}   in theory")  # fmt: skip
    rows = []
    for row in itertools.chain(
        judge_made(options.frames, options.seed), judge_injected(options.frames, options.seed)
    ):
        rows.append(row)
        print(show(row), flush=True)
    certain = [row for row in rows if row.share == 0.0]
    print(
        f"{sum(row.frames for row in certain)} bad frames of the classes that are rejected by "
        f"construction, {sum(row.accepted for row in certain)} accepted; "
        f"{sum(row.frames for row in rows)} in all; {time.monotonic() - began_s:.0f} s"
    )
    return 0 if all(row.right for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
