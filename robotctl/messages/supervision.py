"""Requests to the supervisor."""

from __future__ import annotations

from typing import Final, TypeAlias

import msgspec


class Restart(msgspec.Struct, frozen=True, tag=True):
    """Restart all processes of the robot, with the stored parameters."""

    stamp_ns: int


class ShutDown(msgspec.Struct, frozen=True, tag=True):
    """Shut down all processes of the robot, and the supervisor."""

    stamp_ns: int


SupervisorRequest: TypeAlias = Restart | ShutDown

LIFE_NS: Final = 1_000_000_000
"""Age above which a request is dropped [ns]: the robot may be armed by then."""
