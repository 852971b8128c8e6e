"""One bought drive as the host sees it: present or lost, identified and set or not, and why not.

What is asked of a drive is a script, a generator that yields an `Exchange` and receives its answer;
it returns what is wrong, or None. `Session` advances it by one frame at a time. A second, shorter
script reads the settings of a drive in service again and again.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Final, TypeAlias

from robotctl.drivers.can.bus_part import Send
from robotctl.drivers.can.presence import Presence
from robotctl.messages.faults import Fault, FaultCode

ANSWER_NS: Final = 100_000_000
"""Time that a drive has for an answer [ns]."""

ATTEMPTS: Final = 3
"""How often an exchange is tried before it counts as unanswered."""

RETRY_NS: Final = 1_000_000_000
"""Pause between a failed commissioning and the next attempt [ns]."""

UNREAD_MAX: Final = 5
"""Readings in a row that may stay unanswered: another tool may use the drive's services."""

_RENEW_NS: Final = 50_000_000
"""Period of renewing `NodeStatus` where nothing but the time of reception changes [ns]."""

_IN_SERVICE, _NOT_YET, _UNHEARD = 5, 127, 0
"""Values of `NodeStatus.nmt_state`."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """Frames to send, in this order, and the answer that ends them.

    Parameters
    ----------
    frames
        Identifiers with flags, and data; none: nothing but the time passes.
    name
        What people call it: "read of the firmware version".
    prefix
        Beginning of the answer; another one is not it.
    attempts
        How often it is tried.
    answer_ns
        Time that the drive has for the answer [ns].
    size
        Fewest bytes of the answer.
    """

    frames: tuple[tuple[int, bytes], ...]
    name: str
    prefix: bytes = b""
    attempts: int = ATTEMPTS
    answer_ns: int = ANSWER_NS
    size: int = 0

    def unanswered(self) -> Fault:
        """Return the fault that nothing came back."""
        return Fault(FaultCode.NODE_NO_ANSWER, f"no answer to the {self.name}")


PAUSE: Final = Exchange((), "pause", attempts=1)
"""Time for something else to happen: as long as an answer may take."""

Script: TypeAlias = Generator[Exchange, bytes | None, Fault | None]
"""Yields exchanges, receives their answers (None: there was none), returns the problem."""


class _Phase(enum.Enum):
    SILENT = "not heard"
    WORKING = "script runs"
    READY = "in service"
    REFUSED = "failed, waits for another attempt"


class Session(Presence):
    """State machine of one drive, advanced by its frames and by `serve`.

    Parameters
    ----------
    node_id, name
        Number and name of the drive.
    call
        Frame that makes a drive answer of which nothing is heard; None: it has a heartbeat, and
        gets no frames before that is heard.
    script
        Makes a new run of the commissioning.
    reading
        Makes a new run of the script that reads the settings back.
    reading_ns
        Period of that, and pause after one without an answer [ns].
    timeout_ns
        A drive silent for longer is lost [ns].

    Attributes
    ----------
    in_service
        Whether the drive may be used.
    """

    __slots__ = (
        "_attempts",
        "_call",
        "_exchange",
        "_is_reading",
        "_make_reading",
        "_make_script",
        "_next_frame",
        "_phase",
        "_reading_due_ns",
        "_reading_ns",
        "_renew_ns",
        "_script",
        "_timeout_ns",
        "_unread",
        "_wait_until_ns",
        "in_service",
    )

    def __init__(
        self,
        node_id: int,
        name: str,
        call: tuple[int, bytes] | None,
        script: Callable[[], Script],
        reading: Callable[[], Script],
        reading_ns: int,
        timeout_ns: int,
    ) -> None:
        rate = "" if call else " (its heartbeat rate must not be 0)"
        fault = Fault(FaultCode.NODE_NOT_HEARD, f"not heard on the bus{rate}")
        super().__init__(node_id, name, _UNHEARD, fault)
        self._call = call
        self._make_script = script
        self._make_reading = reading
        self._reading_ns = reading_ns
        self._timeout_ns = timeout_ns
        self._phase = _Phase.SILENT
        self._script: Script | None = None
        self._exchange: Exchange | None = None
        self._next_frame = self._attempts = 0
        self._wait_until_ns = 0
        """When the answer is overdue, a refused drive is tried again, or settings are read."""
        self._is_reading = False
        self._reading_due_ns = 0
        self._unread = 0
        self._renew_ns = 0
        self.in_service = False
        self._refresh()

    @property
    def silent(self) -> bool:
        """Whether the drive is silent."""
        return self._phase is _Phase.SILENT

    def hear(self, stamp_ns: int) -> None:
        """Note that the drive was heard at a time [ns]."""
        self.heard_ns = stamp_ns
        if stamp_ns >= self._renew_ns:
            if self._phase is _Phase.SILENT:
                self.restart()
            else:
                self._refresh()

    def restart(self) -> None:
        """Restart commissioning: the drive has booted, or its past is unknown."""
        self.boots += 1
        self._begin(Fault(FaultCode.NODE_STARTING, "is being identified"))

    def answer(self, data: bytes, now_ns: int) -> None:
        """Take an answer of the drive; ignored where none is awaited."""
        exchange = self._exchange
        if (
            exchange is not None
            and exchange.frames
            and self._next_frame == len(exchange.frames)
            and data.startswith(exchange.prefix)
            and len(data) >= exchange.size
        ):
            self._advance(data, now_ns)

    def check(self, now_ns: int) -> None:
        """Take the drive out of service if it is silent for too long; give up overdue answers."""
        if now_ns - self.heard_ns > self._timeout_ns and self._phase is not _Phase.SILENT:
            self._drop_script()
            self._phase = _Phase.SILENT
            self.in_service = False
            self._wait_until_ns = self._renew_ns = 0
            what = "nothing heard" if self._call else "no heartbeat"
            text = f"{what} for {self._timeout_ns / 1e6:g} ms"
            self._say(Fault(FaultCode.NODE_SILENT, text))
            return
        exchange = self._exchange
        if (
            exchange is not None
            and self._next_frame == len(exchange.frames)
            and now_ns >= self._wait_until_ns
        ):
            self._attempts += 1
            self._next_frame = 0
            if self._attempts >= exchange.attempts:
                self._advance(None, now_ns)

    def refuse(self, fault: Fault, now_ns: int) -> None:
        """Take the drive out of service, say why, and try again later."""
        self._drop_script()
        self._phase = _Phase.REFUSED
        self.in_service = False
        self._wait_until_ns = now_ns + RETRY_NS
        self._say(fault)

    def serve(self, send: Send, now_ns: int) -> bool:
        """Send at most one frame; return whether it did."""
        if self._exchange is None:
            if now_ns < self._wait_until_ns:
                return False
            if self._phase is _Phase.SILENT:
                self._wait_until_ns = now_ns + RETRY_NS // 4
                return self._call is not None and send(*self._call)
            if self._phase is _Phase.REFUSED:
                self._begin(None)
            elif self._phase is _Phase.READY:
                self._is_reading = True
                self._reading_due_ns = now_ns + self._reading_ns
                self._run(self._make_reading())
            if self._script is not None and self._exchange is None:
                self._advance(None, now_ns)  # to its first exchange
        exchange = self._exchange
        if exchange is None or self._next_frame == len(exchange.frames):
            return False
        if not send(*exchange.frames[self._next_frame]):
            return False
        self._next_frame += 1
        self._wait_until_ns = now_ns + exchange.answer_ns
        return True

    def _begin(self, fault: Fault | None) -> None:
        """Start commissioning; a repeated attempt leaves the sentence of the last failure."""
        self._drop_script()
        self._phase = _Phase.WORKING
        self.in_service = False
        self._is_reading = False
        self._wait_until_ns = 0
        self._run(self._make_script())
        if fault is not None:
            self._say(fault)

    def _run(self, script: Script) -> None:
        self._script = script
        self._exchange = None

    def _advance(self, answer: bytes | None, now_ns: int) -> None:
        """Pass an answer to the script, and take its next exchange or its end."""
        script = self._script
        if script is None:
            return
        try:
            exchange = script.send(None if self._exchange is None else answer)
            self._exchange = exchange
            self._next_frame = self._attempts = 0
            self._wait_until_ns = now_ns + exchange.answer_ns
        except StopIteration as stop:
            self._script = self._exchange = None
            self._finish(stop.value, now_ns)

    def _finish(self, fault: Fault | None, now_ns: int) -> None:
        """Put the drive into service, leave it there, or refuse it."""
        if not self._is_reading:
            self._reading_due_ns = now_ns + self._reading_ns
        if fault is None:
            self._unread = 0
        elif self._is_reading and fault.code is FaultCode.NODE_NO_ANSWER:
            # No answer is no proof of a change: only several in a row count.
            self._unread += 1
            self._reading_due_ns = now_ns + self._reading_ns
            fault = fault if self._unread > UNREAD_MAX else None
        if fault is not None:
            self.refuse(fault, now_ns)
            return
        self._wait_until_ns = self._reading_due_ns
        if not self._is_reading:
            self._phase = _Phase.READY
            self.in_service = True
            self._say(None)

    def _drop_script(self) -> None:
        if self._script is not None:
            self._script.close()
        self._script = self._exchange = None

    def _refresh(self) -> None:
        """Update `status`."""
        is_silent = self._phase is _Phase.SILENT
        self._renew_ns = 0 if is_silent else self.heard_ns + _RENEW_NS
        absent = _UNHEARD if is_silent else _NOT_YET
        self.nmt_state = _IN_SERVICE if self.in_service else absent
        super()._refresh()
