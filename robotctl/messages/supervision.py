"""Requests to the supervisor."""

from __future__ import annotations

from typing import Final, TypeAlias

import msgspec


class Restart(msgspec.Struct, frozen=True, tag=True):
    """End all processes of the robot and start them again, with the parameters as they are kept."""

    stamp_ns: int


class ShutDown(msgspec.Struct, frozen=True, tag=True):
    """End all processes of the robot, and the supervisor."""

    stamp_ns: int


SupervisorRequest: TypeAlias = Restart | ShutDown

LIFE_NS: Final = 1_000_000_000
"""An older request is not carried out [ns]: the robot may be armed by now."""
