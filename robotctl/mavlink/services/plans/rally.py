"""Rally points: upload and download; RTL leads to the nearest one that a way leads to."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import ClassVar, Final

import msgspec
from pymavlink.dialects.v20 import common

from robotctl.mavlink.context import Request
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.fence_items import plain
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.transfer import Transfer
from robotctl.mavlink.missions.translate import BadItem, bounded_place, check_params
from robotctl.messages.control import NavigationState
from robotctl.messages.fence import RallyFile, SetRally

_POINT: Final[int] = common.MAV_CMD_NAV_RALLY_POINT


@dataclass(frozen=True, slots=True)
class RallyPlan:
    """Rally points that came over MAVLink."""

    items: tuple[MissionItem, ...] = ()
    """Items as they came."""
    places: tuple[tuple[float, float], ...] = ()
    """In `world` [m]."""
    origin: Origin | None = None
    """Origin by which places on the globe became those of `world`; None: there are none."""
    content: bytes = b""
    """The file that was made of them."""

    @property
    def crc(self) -> int:
        """Checksum by which navigation names them; 0: none."""
        return zlib.crc32(self.content)


class _Kept(RallyFile, frozen=True):
    """The whole file; navigation reads the first part alone."""

    items: tuple[MissionItem, ...]
    origin: Origin | None


class RallyPoints(Transfer[RallyPlan]):
    """Takes rally points from one ground station at a time, and gives them to all."""

    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    kind = common.MAV_MISSION_TYPE_RALLY
    word = "rally points"

    def read(self, content: bytes) -> RallyPlan:
        """Return the rally points of a file; none of an empty one, or of one that is damaged."""
        try:
            kept = msgspec.json.decode(content, type=_Kept)
        except (msgspec.DecodeError, ValueError):
            return RallyPlan()
        return RallyPlan(kept.items, kept.places, kept.origin, content)

    def check(self, item: MissionItem, seq: int) -> None:
        """Check a single item."""
        if item.command != _POINT:
            why = f"command {item.command} is no rally point"
            raise BadItem(seq, common.MAV_MISSION_UNSUPPORTED, why)
        check_params(item, seq)
        bounded_place(item, seq, self._context.origin)

    def plan_of(self, items: list[MissionItem]) -> tuple[RallyPlan, list[str]]:
        """Return the places, and a note where the robot cannot use them."""
        origin = self._context.origin
        kept = tuple(plain(item) for item in items)
        places = tuple(bounded_place(item, seq, origin) for seq, item in enumerate(kept))
        used = origin if any(each.is_global for each in kept) else None
        content = msgspec.json.encode(_Kept(places=places, items=kept, origin=used))
        plans = self._context.robot.plans
        notes = [] if plans else ["ignored: the robot cannot plan, it returns the way it came"]
        return RallyPlan(kept, places, used, content), notes

    def request(self, plan: RallyPlan, file: str, now_ns: int) -> Request:  # noqa: ARG002
        """Return the request to return to these places."""
        return SetRally(now_ns, plan.places, plan.crc)

    def is_taken(self, plan: RallyPlan, navigation: NavigationState) -> bool:
        """Return whether the robot has them."""
        return navigation.rally_crc == plan.crc
