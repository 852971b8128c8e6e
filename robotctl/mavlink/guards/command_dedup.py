"""Late copies of commands that allow motion.

A sender without an acknowledgement sends its command again; the common ground stations do so after
0.5 to 3 s. Networks and radios repeat frames, too. A copy that arrives after the robot was stopped,
or has finished, must not set it off again.

A command is a copy where it means the same as one of the same sender whose answer is no older than

| `confirmation` of COMMAND_LONG | window |
|---|---|
| 0, or a message without that field | `REPEAT_NS` |
| more, by which the sender says that it repeats | `CONFIRMED_REPEAT_NS` |

and its sender has asked for nothing else since, or its frame has the number of one that was
answered. So MANUAL, HOLD and MANUAL of one sender are three wishes, however fast they come. MANUAL
of one sender that HOLD of another has ended is none in that time, since MAVSDK repeats what was not
answered after 0.5 s, by a new frame with `confirmation` 0. (mavros arms with `confirmation` 1 at
once.)

Copies do not prolong the window. A copy is never carried out. Its answer is that of the first where
that was a refusal, or what was asked for still holds; else it is "temporarily rejected". To repeat
a request on purpose, send it again after the window. Stops do not pass this module: they are always
executed.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable
from typing import Final, NamedTuple

from robotctl.mavlink.command import ACCEPTED, TEMPORARILY_REJECTED, Frame
from robotctl.messages.mavlink_port import Address

REPEAT_NS = 1_000_000_000
CONFIRMED_REPEAT_NS = 5_000_000_000
"""QGroundControl sends again after 3 s without an acknowledgement; the rest is for transport
[ns]."""
MOST_SENDERS: Final = 256
"""Invented senders must not fill the memory."""


class _Answered(NamedTuple):
    result: int
    answered_ns: int
    sequences: frozenset[int]
    """Numbers of the frames that asked for it lately."""


class LateCopies:
    """Remembers the answers to commands while copies of them may arrive."""

    def __init__(self) -> None:
        self._answered: dict[tuple[Address, Hashable], _Answered] = {}
        """In the order in which they were answered."""
        self._last: dict[Address, Hashable] = {}
        """Last request of each sender."""

    def ask(self, sender: Address, meaning: Hashable) -> None:
        """Note a request of a sender: it replaces what the sender has asked for before."""
        self._last.pop(sender, None)
        self._last[sender] = meaning
        if len(self._last) > MOST_SENDERS:
            del self._last[next(iter(self._last))]

    def remember(
        self,
        sender: Address,
        meaning: Hashable,
        result: int,
        now_ns: int,
        sequences: Collection[int] = (),
    ) -> None:
        """Record that a command of `sender` has been answered with a MAV_RESULT.

        `meaning` is equal for commands that ask for the same, `sequences` are the numbers of its
        frames.
        """
        before = self._answered.pop((sender, meaning), None)
        numbers = frozenset(sequences)
        if before is not None and now_ns - before.answered_ns <= REPEAT_NS:
            numbers |= before.sequences
        self._answered[sender, meaning] = _Answered(result, now_ns, numbers)
        while now_ns - self._answered[oldest := next(iter(self._answered))].answered_ns > (
            CONFIRMED_REPEAT_NS
        ):
            del self._answered[oldest]

    def answer(
        self,
        frame: Frame,
        meaning: Hashable,
        now_ns: int,
        *,
        holds: bool,
    ) -> int | None:
        """Return the MAV_RESULT of a copy, None if the command is to be carried out.

        One that is carried out is what its sender asks for from now on.

        Parameters
        ----------
        frame
            The frame that it came in.
        meaning
            As in `remember`.
        now_ns : int
            Monotonic time [ns].
        holds : bool
            What the command asks for is so at present.
        """
        first = self._answered.get((frame.sender, meaning))
        window_ns = CONFIRMED_REPEAT_NS if frame.confirmation else REPEAT_NS
        if (
            first is None
            or now_ns - first.answered_ns > window_ns
            or not self._may_repeat(frame, meaning, first)
        ):
            self.ask(frame.sender, meaning)
            return None
        # Accepted, but no longer true: repeating "accepted" would lie to the sender.
        return first.result if holds or first.result != ACCEPTED else TEMPORARILY_REJECTED

    def _may_repeat(self, frame: Frame, meaning: Hashable, first: _Answered) -> bool:
        """Return whether a request may be a repetition."""
        is_last = self._last.get(frame.sender, meaning) == meaning
        return is_last or frame.sequence in first.sequences
