"""Late copies of commands that allow motion.

A sender without an acknowledgement sends its command again; the common ground stations do so after
0.5 to 3 s. Networks and radios repeat frames, too. A copy that arrives after the robot was stopped,
or has finished, must not set it off again.

A command is a copy where it means the same as one of the same sender whose answer is no older than

| `confirmation` of COMMAND_LONG | window |
|---|---|
| 0, or a message without that field | `REPEAT_NS` |
| more, by which the sender itself says that it repeats | `CONFIRMED_REPEAT_NS` |

Copies do not prolong the window. A copy is never carried out. Its answer is that of the first where
that was a refusal, or what was asked for still holds; else it is "temporarily rejected". To repeat
a request on purpose, send it again after the window. Stops do not pass this module: they are always
executed.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import NamedTuple

from robotctl.mavlink.command import ACCEPTED, TEMPORARILY_REJECTED

REPEAT_NS = 1_000_000_000
CONFIRMED_REPEAT_NS = 5_000_000_000
"""QGroundControl sends again after 3 s without an acknowledgement; the rest is for transport
[ns]."""


class _Answered(NamedTuple):
    result: int
    answered_ns: int


class LateCopies:
    """Remembers the answers to commands while copies of them may arrive."""

    def __init__(self) -> None:
        self._answered: dict[tuple[tuple[int, int], Hashable], _Answered] = {}
        """In the order in which they were answered."""

    def remember(
        self, sender: tuple[int, int], meaning: Hashable, result: int, now_ns: int
    ) -> None:
        """Take down that a command of `sender` has been answered with a MAV_RESULT.

        `meaning` is equal for commands that ask for the same.
        """
        self._answered.pop((sender, meaning), None)
        self._answered[sender, meaning] = _Answered(result, now_ns)
        while now_ns - self._answered[oldest := next(iter(self._answered))].answered_ns > (
            CONFIRMED_REPEAT_NS
        ):
            del self._answered[oldest]

    def answer(
        self,
        sender: tuple[int, int],
        meaning: Hashable,
        now_ns: int,
        *,
        confirmation: int,
        holds: bool,
    ) -> int | None:
        """Return the MAV_RESULT of a copy, None if the command is to be carried out.

        Parameters
        ----------
        sender, meaning
            As in `remember`.
        now_ns : int
            Monotonic time [ns].
        confirmation : int
            The field of COMMAND_LONG, 0 if there is none.
        holds : bool
            What the command asks for is so at present.
        """
        first = self._answered.get((sender, meaning))
        window_ns = CONFIRMED_REPEAT_NS if confirmation else REPEAT_NS
        if first is None or now_ns - first.answered_ns > window_ns:
            return None
        # Accepted, but no longer true: repeating "accepted" would lie to the sender.
        return first.result if holds or first.result != ACCEPTED else TEMPORARILY_REJECTED
