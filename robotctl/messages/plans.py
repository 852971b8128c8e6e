"""Mission and bounds of the robot, for people and ground stations.

Navigation publishes these messages when they change, and every few seconds for late subscribers.
"""

from __future__ import annotations

import msgspec

from robotctl.model.fence import Fence, Point


class DrawnZone(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A polygon of `world` with its own speed limit [m, m/s]; 0: the robot keeps out.

    `origin` is its source: the `robot`'s file, its `mission`, or the `map`, if drawn there.
    """

    name: str
    corners: tuple[Point, ...]
    speed_m_s: float = 0.0
    origin: str = "map"


class SetZones(msgspec.Struct, frozen=True, tag=True):
    """Replace the drawn zones; those of robot and mission stay.

    `crc` identifies them in `BoundsView`; 0: there are none.
    """

    stamp_ns: int
    zones: tuple[DrawnZone, ...]
    crc: int


class ZonesFile(msgspec.Struct, frozen=True):
    """File of the drawn zones."""

    zones: tuple[DrawnZone, ...]


class MissionView(msgspec.Struct, frozen=True, tag=True):
    """The mission of AUTO, as in its file; empty: there is none.

    `crc` is `NavigationState.mission_crc`.
    """

    stamp_ns: int
    file: str
    crc: int
    content: bytes


class KnownPlace(msgspec.Struct, frozen=True):
    """A place of the topological map with known coordinates [m]."""

    name: str
    x_m: float
    y_m: float


class BoundsView(msgspec.Struct, frozen=True, tag=True):
    """Bounds of the robot, and its known places, in `world`.

    `fence` is in force while `fence_enabled`; `zones_crc` identifies the drawn zones. `links` are
    pairs of indices of connected `places`. `home` is the goal of RTL (m, rad) unless a point of
    `rally` is nearer.
    """

    stamp_ns: int
    fence: Fence
    fence_crc: int
    fence_enabled: bool
    zones: tuple[DrawnZone, ...]
    zones_crc: int
    rally: tuple[Point, ...]
    rally_crc: int
    home: tuple[float, float, float]
    places: tuple[KnownPlace, ...] = ()
    links: tuple[tuple[int, int], ...] = ()
