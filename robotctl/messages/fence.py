"""Requests about a robot's fence and rally points, and how it keeps to the fence."""

from __future__ import annotations

from typing import TypeAlias

import msgspec

from robotctl.model.fence import Fence, Point


class SetFence(msgspec.Struct, frozen=True, tag=True):
    """Keep to this fence in place of the present one, from now on; an empty one: to none.

    `crc` names it in `FenceState`; 0: there is none.
    """

    stamp_ns: int
    fence: Fence
    crc: int


class EnableFence(msgspec.Struct, frozen=True, tag=True):
    """Keep to the fence, or not until it is enabled again, replaced, or navigation restarts."""

    stamp_ns: int
    enabled: bool


class SetRally(msgspec.Struct, frozen=True, tag=True):
    """Return to the nearest of these places of `world` (m) in place of home; none: home again.

    `crc` names them in `NavigationState.rally_crc`; 0: there are none.
    """

    stamp_ns: int
    places: tuple[Point, ...]
    crc: int


class FenceState(msgspec.Struct, frozen=True):
    """How the robot keeps to its fence.

    `crc` names the fence, 0: there is none. `limits`: the robot is held back by it now.
    `breached`: a part of its body is beyond, `breaches` how often that began and `breached_ns`
    when it last did (ns).
    """

    crc: int = 0
    enabled: bool = False
    limits: bool = False
    breached: bool = False
    breaches: int = 0
    breached_ns: int = 0


class FenceFile(msgspec.Struct, frozen=True):
    """Part of the file that a fence is kept in that navigation reads."""

    fence: Fence


class RallyFile(msgspec.Struct, frozen=True):
    """Part of the file that rally points are kept in that navigation reads."""

    places: tuple[Point, ...]


FenceRequest: TypeAlias = SetFence | EnableFence
