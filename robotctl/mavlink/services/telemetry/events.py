"""EVENT: changes of state and mode, numbered, so that what a link lost can be asked for again.

https://mavlink.io/en/services/events.html. People read the same as STATUSTEXT; events are for
programs, and go to those that get CURRENT_EVENT_SEQUENCE.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from robotctl.dialect import additions
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.event_kinds import (
    COMPONENT_BITS,
    EventKind,
    mode_arguments,
    state_arguments,
)
from robotctl.mavlink.frames import boot_ms
from robotctl.mavlink.service import Microservice
from robotctl.messages.control import Mode, SafetyState, Severity
from robotctl.messages.faults import FaultCode
from robotctl.messages.mavlink_port import Message, Peer, source

KEPT: Final = 64
"""Events that may be asked for again."""
RATE_HZ: Final = 0.5
_ARGUMENTS: Final = 40
_COUNT: Final = 0x1_0000
"""Count after which numbers start again."""
_NEW_NS: Final = 10_000_000_000
"""Time after its start for which the robot says that its numbers have started again [ns]."""
_STOPS: Final = frozenset({SafetyState.FAULT, SafetyState.EMERGENCY_STOP})


class Events(Microservice):
    """Broadcasts events, and repeats those asked for."""

    handles = frozenset({additions.MAVLINK_MSG_ID_REQUEST_EVENT})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._events: deque[Message] = deque(maxlen=KEPT)
        self._sequence = 0
        self._state: tuple[SafetyState, FaultCode] | None = None
        self._mode: Mode | None = None
        self._began_ns: int | None = None

    def streams(self) -> tuple[Stream, ...]:
        """Return CURRENT_EVENT_SEQUENCE, and the last event on request."""
        return (
            Stream(additions.MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE, self._current, RATE_HZ),
            Stream(additions.MAVLINK_MSG_ID_EVENT, lambda _: list(self._events)[-1:], None),
        )

    def step(self, now_ns: int) -> None:
        """Tell what has changed."""
        self._began_ns = now_ns if self._began_ns is None else self._began_ns
        control = self._context.fresh_control(now_ns)
        if control is not None and (control.state, control.fault) != self._state:
            self._state = control.state, control.fault
            level = Severity.CRITICAL if control.state in _STOPS else Severity.NOTICE
            self._tell(*state_arguments(control.state, control.fault), level, control.stamp_ns)
        navigation = self._context.fresh_navigation(now_ns)
        if navigation is not None and navigation.mode is not self._mode:
            self._mode = navigation.mode
            self._tell(*mode_arguments(navigation.mode), Severity.NOTICE, navigation.stamp_ns)

    def _tell(self, kind: EventKind, arguments: bytes, level: Severity, stamp_ns: int) -> None:
        self._sequence = (self._sequence + 1) % _COUNT
        number = self._context.config.component_id << COMPONENT_BITS | kind
        event = additions.MAVLink_event_message(
            0,
            0,
            number,
            boot_ms(stamp_ns),
            self._sequence,
            level << 4 | level,
            list(arguments.ljust(_ARGUMENTS, b"\0")),
        )
        self._events.append(event)
        receivers = self._context.receivers(additions.MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE)
        self._context.links.broadcast(event, receivers)

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:  # noqa: ARG002
        """Repeat the events of a range of numbers, or say that they are not kept."""
        kept = {event.sequence: event for event in self._events}
        oldest = self._events[0].sequence if self._events else 0
        many = (message.last_sequence - message.first_sequence) % _COUNT + 1
        for offset in range(min(many, KEPT)):
            sequence = (message.first_sequence + offset) % _COUNT
            answer = kept.get(sequence)
            if answer is None:
                answer = additions.MAVLink_response_event_error_message(
                    *source(message),
                    sequence,
                    oldest,
                    additions.MAV_EVENT_ERROR_REASON_UNAVAILABLE,
                )
            self._context.links.reply(answer, peer)

    def _current(self, now_ns: int) -> list[Message]:
        if not self._events:
            return []
        is_new = self._began_ns is None or now_ns - self._began_ns < _NEW_NS
        flags = additions.MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET if is_new else 0
        return [additions.MAVLink_current_event_sequence_message(self._sequence, flags)]
