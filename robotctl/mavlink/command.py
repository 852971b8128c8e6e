"""A command of a ground station, as COMMAND_LONG and COMMAND_INT bring it, and its results."""

from __future__ import annotations

import math
from typing import NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.messages.mavlink_port import Address, Peer

ACCEPTED: int = common.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED: int = common.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = common.MAV_RESULT_DENIED
IN_PROGRESS: int = common.MAV_RESULT_IN_PROGRESS
CANCELLED: int = additions.MAV_RESULT_CANCELLED
FAILED: int = common.MAV_RESULT_FAILED
UNSUPPORTED: int = common.MAV_RESULT_UNSUPPORTED
INT_ONLY: int = common.MAV_RESULT_COMMAND_INT_ONLY
UNSUPPORTED_FRAME: int = additions.MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME

MAX_PENDING = 8
"""Maximum waiting requests of each kind, no more than control answers at once: a flood of invented
senders must not delay a stop. The others are told to ask again."""


class Frame(NamedTuple):
    """Identity of a frame with a request.

    `confirmation` counts how often its sender has sent the request before, as far as it says;
    `sequence` is the number of the frame, 0 to 255.
    """

    sender: Address
    sequence: int
    confirmation: int = 0


class Command(NamedTuple):
    """A command and its origin.

    `params` are param1 to param7; of a COMMAND_INT, 5 and 6 are its integers x and y.
    `confirmation` counts how often the sender has sent it before; COMMAND_INT does not say. `frame`
    is that of x and y, which COMMAND_LONG does not have.
    """

    number: int
    params: tuple[float, ...]
    sender: Address
    peer: Peer
    confirmation: int = 0
    frame: int | None = None
    sequence: int = 0

    @property
    def origin(self) -> Frame:
        """The frame that it came in."""
        return Frame(self.sender, self.sequence, self.confirmation)

    @property
    def key(self) -> tuple[Address, int, Peer]:
        """Key that identifies it among those that wait."""
        return self.sender, self.number, self.peer

    def whole(self, index: int) -> int | None:
        """Return one of `params` that must be a whole number, None if it is none."""
        value = self.params[index]
        return int(value) if math.isfinite(value) and value == int(value) else None
