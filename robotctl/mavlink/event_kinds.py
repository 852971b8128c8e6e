"""The events that the robot tells of, and the metadata by which stations put them into words.

https://mavlink.io/en/services/events.html; the schema is validation/schema.json of
https://github.com/mavlink/libevents.
"""

from __future__ import annotations

import enum
import json
import struct
from typing import Any, Final

from robotctl.messages.control import Mode, SafetyState
from robotctl.messages.faults import FaultCode

NAMESPACE: Final = "robotctl"
COMPONENT_BITS: Final = 24
"""Bits below the component in an event's number."""


class EventKind(enum.IntEnum):
    """Lower 24 bits of an event's number."""

    STATE = 1
    """The state, a byte."""
    STOPPED = 2
    """The state, a byte, and the FaultCode, two bytes."""
    MODE = 3
    """The mode, a byte."""


def state_arguments(state: SafetyState, fault: FaultCode) -> tuple[EventKind, bytes]:
    """Return the event of a state, and its arguments."""
    if fault is FaultCode.NONE:
        return EventKind.STATE, struct.pack("<B", state)
    return EventKind.STOPPED, struct.pack("<BH", state, fault)


def mode_arguments(mode: Mode) -> tuple[EventKind, bytes]:
    """Return the event of a mode, and its arguments."""
    return EventKind.MODE, struct.pack("<B", mode)


def event_metadata(component: int) -> bytes:
    """Return the events of a component as JSON."""
    kinds = {
        EventKind.STATE: ("State {1}", (("state_t", "state"),)),
        EventKind.STOPPED: ("State {1}: {2}", (("state_t", "state"), ("fault_t", "fault"))),
        EventKind.MODE: ("Mode {1}", (("mode_t", "mode"),)),
    }
    events = {
        str(kind.value): {
            "name": kind.name.lower(),
            "message": message,
            "arguments": [{"type": of, "name": name} for of, name in arguments],
        }
        for kind, (message, arguments) in kinds.items()
    }
    described = {
        "namespace": NAMESPACE,
        "enums": {
            "state_t": {"type": "uint8_t", "entries": _entries(SafetyState)},
            "fault_t": {"type": "uint16_t", "entries": _entries(FaultCode)},
            "mode_t": {"type": "uint8_t", "entries": _entries(Mode)},
        },
        "event_groups": {"default": {"events": events}},
    }
    return json.dumps({"version": 1, "components": {str(component): described}}).encode()


def _entries(members: type[enum.IntEnum]) -> dict[str, Any]:
    names = {each.value: each.name.lower() for each in members}
    return {
        str(value): {"name": name, "description": name.replace("_", " ")}
        for value, name in names.items()
    }
