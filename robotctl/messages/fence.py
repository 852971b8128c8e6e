"""Requests about a robot's fence and rally points, and the state of the fence."""

from __future__ import annotations

from typing import TypeAlias

import msgspec

from robotctl.model.fence import Fence, Point


class SetFence(msgspec.Struct, frozen=True, tag=True):
    """Replace the fence; an empty one removes it.

    `crc` identifies it in `FenceState`; 0: there is none.
    """

    stamp_ns: int
    fence: Fence
    crc: int


class EnableFence(msgspec.Struct, frozen=True, tag=True):
    """Enable the fence, or disable it until enabled, replaced, or navigation restarts."""

    stamp_ns: int
    enabled: bool


class SetRally(msgspec.Struct, frozen=True, tag=True):
    """Set rally points of `world` (m), of which the nearest replaces home; none: home again.

    `crc` identifies them in `NavigationState.rally_crc`; 0: there are none.
    """

    stamp_ns: int
    places: tuple[Point, ...]
    crc: int


class FenceState(msgspec.Struct, frozen=True):
    """State of the robot's fence.

    `crc` identifies the fence, 0: there is none. `limits`: it limits the robot now. `breached`: a
    part of the body is beyond it, with the number `breaches` of breaches so far, and the time
    `breached_ns` of the last (ns).
    """

    crc: int = 0
    enabled: bool = False
    limits: bool = False
    breached: bool = False
    breaches: int = 0
    breached_ns: int = 0


class FenceFile(msgspec.Struct, frozen=True):
    """Part of the stored fence's file that navigation reads."""

    fence: Fence


class RallyFile(msgspec.Struct, frozen=True):
    """Part of the stored rally points' file that navigation reads."""

    places: tuple[Point, ...]


FenceRequest: TypeAlias = SetFence | EnableFence
