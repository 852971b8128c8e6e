"""The probe of a kind of drive: read-only questions, and what frames say about who is on the bus.

A probe does no input or output. The scanner hands it every frame and sends its questions, each only
once no drive of another protocol can be there that would take it, or its answer, for a command:
identifiers of 11 bits mean different things to CANopen and to an ODrive.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final, NamedTuple

from robotctl.messages.ports import Frame

ANSWER_NS: Final = 50_000_000
"""Time that a device has for an answer [ns]."""

_FEWEST: Final = 10
"""Minimum number of frames to tell two senders from one."""

_MOST: Final = 13
"""Maximum number of frames that are judged, the newest: the first may have waited for a bus that
did not work yet."""

_EVEN: Final = 0.2
"""Deviation of intervals that counts as none, as a share of their mean."""


class Question(NamedTuple):
    """A frame that only asks.

    Parameters
    ----------
    number
        Number of the asked device.
    arbitration_id, data
        The frame.
    answer_id
        Identifier of the answer.
    """

    number: int
    arbitration_id: int
    data: bytes
    answer_id: int


@dataclass(frozen=True, slots=True)
class Found:
    """A device on the bus.

    Parameters
    ----------
    protocol
        Its protocol, for people.
    number
        Its number, as that protocol counts them.
    kind
        Of the table `[[motor]]` that it needs; empty: it is no motor drive.
    name
        Name that it tells, or of a node of ours.
    firmware, state
        What it says of them; empty: nothing.
    keys
        Keys of its table besides kind, name, number and axes.
    hints
        Lines to stand above its table: what its owner has to fill in.
    axes
        Wheels that it can turn.
    clash
        Sign of a second device with its number; empty: none.
    """

    protocol: str
    number: int
    kind: str = ""
    name: str = ""
    firmware: str = ""
    state: str = ""
    keys: Mapping[str, Any] = field(default_factory=dict)
    hints: tuple[str, ...] = ()
    axes: int = 1
    clash: str = ""


class Probe:
    """Base of the probes: questions still to be asked, and who was heard.

    Parameters
    ----------
    protocol
        Protocol on the wire; probes of the same need no protection from each other.
    questions
        What is asked of all numbers. Of several questions to one number any one is enough, and the
        first that does no harm is sent.
    """

    def __init__(self, protocol: str, questions: Collection[Question] = ()) -> None:
        self.protocol = protocol
        self.heard: set[int] = set()
        """Numbers of devices that are there."""
        self.command_heard = ""
        """Name of a frame that only a controller sends; empty: none was heard."""
        self._open: dict[int, list[Question]] = {}
        for each in questions:
            self._open.setdefault(each.number, []).append(each)
        self._asked_ns: dict[int, int] = {}
        self._clashes: dict[int, str] = {}

    def questions(self, now_ns: int) -> list[Question]:  # noqa: ARG002 - some wait between questions
        """Return what it would like to ask now; each is sent at most once."""
        return [each for questions in self._open.values() for each in questions]

    def on_sent(self, question: Question, now_ns: int) -> None:
        """Note that a question is on its way."""
        self._open.pop(question.number, None)
        self._asked_ns[question.number] = now_ns

    def is_absent(self, number: int, now_ns: int) -> bool:
        """Return whether a device is known not to be there: it was asked and did not answer."""
        asked_ns = self._asked_ns.get(number)
        return asked_ns is not None and number not in self.heard and now_ns - asked_ns >= ANSWER_NS

    def is_waiting(self, now_ns: int) -> bool:
        """Return whether an answer may still come."""
        return any(now_ns - asked_ns < ANSWER_NS for asked_ns in self._asked_ns.values())

    def awaits(self, number: int, stamp_ns: int) -> bool:
        """Return whether a frame received at a time [ns] may answer a question to a number."""
        asked_ns = self._asked_ns.get(number)
        return asked_ns is not None and stamp_ns - asked_ns < ANSWER_NS

    def clashes(self, number: int, sign: str) -> None:
        """Note a sign of two devices with one number."""
        self._clashes.setdefault(number, sign)

    # What a kind of drive adds ------------------------------------------------------------------

    def obeyed_by(self, arbitration_id: int) -> Collection[int]:
        """Return the numbers whose devices would take a frame for a command."""
        raise NotImplementedError

    def take(self, frame: Frame) -> None:
        """Take a frame of the bus; own frames are not among them."""
        raise NotImplementedError

    def found(self) -> tuple[Found, ...]:
        """Return the devices known so far."""
        raise NotImplementedError


def come_from_two(stamps_ns: Sequence[int]) -> bool:
    """Return whether frames of one identifier have the rhythm of two senders.

    Two with the same period give intervals that are long and short in turn. Where the second sends
    half-way between the first's they look as one with half the period.
    """
    if len(stamps_ns) < _FEWEST:
        return False
    intervals = [late - early for early, late in pairwise(stamps_ns[-_MOST:])]
    means = []
    for each in (intervals[::2], intervals[1::2]):
        mean = sum(each) / len(each)
        if max(abs(value - mean) for value in each) > _EVEN * mean + 1e6:
            return False
        means.append(mean)
    return abs(means[0] - means[1]) > _EVEN * sum(means)
