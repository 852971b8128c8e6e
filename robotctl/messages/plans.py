"""Mission and bounds of the robot, for people and ground stations.

Navigation publishes these messages when they change, and every few seconds for late subscribers.
"""

from __future__ import annotations

import msgspec

from robotctl.model.fence import Fence, Point


class DrawnZone(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A polygon of `world` with its own speed limit [m, m/s]; 0: the robot keeps out.

    `origin` says where it is from: the `robot`'s file, its `mission`, or the `map`, where somebody
    has drawn it.
    """

    name: str
    corners: tuple[Point, ...]
    speed_m_s: float = 0.0
    origin: str = "map"


class SetZones(msgspec.Struct, frozen=True, tag=True):
    """Keep to these zones in place of those drawn before, beside those of robot and mission.

    `crc` names them in `BoundsView`; 0: there are none.
    """

    stamp_ns: int
    zones: tuple[DrawnZone, ...]
    crc: int


class ZonesFile(msgspec.Struct, frozen=True):
    """File that drawn zones are kept in."""

    zones: tuple[DrawnZone, ...]


class MissionView(msgspec.Struct, frozen=True, tag=True):
    """The mission of AUTO as its file has it; empty: there is none.

    `crc` is `NavigationState.mission_crc`.
    """

    stamp_ns: int
    file: str
    crc: int
    content: bytes


class KnownPlace(msgspec.Struct, frozen=True):
    """A place of the topological map, where its coordinates are known [m]."""

    name: str
    x_m: float
    y_m: float


class BoundsView(msgspec.Struct, frozen=True, tag=True):
    """All that bounds the robot, and the places that it knows, in `world`.

    `fence` is kept to while `fence_enabled`; `zones_crc` names the drawn zones. `links` are pairs
    of numbers of `places` with a passage between them. `home` is where RTL leads to (m, rad) if no
    point of `rally` is nearer.
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
