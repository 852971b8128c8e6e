"""A MAVLink fence as shapes of `world`, and the file that it is kept in."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import msgspec
from pymavlink.dialects.v20 import common

from robotctl.mavlink.frames import ned_from_enu
from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.translate import (
    BadItem,
    bounded_place,
    check_altitude,
    check_params,
)
from robotctl.messages.fence import FenceFile
from robotctl.messages.requests import FARTHEST_M
from robotctl.model.fence import Fence, FenceCircle, FencePolygon, Point

_POLYGONS: Final = {
    common.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    common.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES: Final = {
    common.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    common.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}
"""Commands, and whether the robot stays within."""
_RETURN: Final[int] = common.MAV_CMD_NAV_FENCE_RETURN_POINT
_INVALID: Final[int] = common.MAV_MISSION_INVALID
_INVALID_1: Final[int] = common.MAV_MISSION_INVALID_PARAM1
_FEWEST_CORNERS: Final = 3
"""Minimum number of corners of a polygon."""


@dataclass(frozen=True, slots=True)
class FencePlan:
    """A fence that came over MAVLink."""

    items: tuple[MissionItem, ...] = ()
    """Items as they came."""
    fence: Fence = Fence()  # noqa: RUF009 - it does not change
    origin: Origin | None = None
    """Origin by which places on the globe became those of `world`; None: there are none."""
    content: bytes = b""
    """The file that was made of it."""

    @property
    def crc(self) -> int:
        """Checksum by which navigation names the fence; 0: none."""
        return zlib.crc32(self.content)


class _Kept(FenceFile, frozen=True):
    """The whole file; navigation reads the first part alone."""

    items: tuple[MissionItem, ...]
    origin: Origin | None


def read_fence(content: bytes) -> FencePlan:
    """Return the fence of a file; none of an empty one, or of one that is damaged."""
    try:
        kept = msgspec.json.decode(content, type=_Kept)
    except (msgspec.DecodeError, ValueError):
        try:
            drawn = msgspec.json.decode(content, type=FenceFile, strict=True)
        except (msgspec.DecodeError, ValueError):
            return FencePlan()
        return FencePlan(fence_items(drawn.fence, None), drawn.fence, None, content)
    return FencePlan(kept.items, kept.fence, kept.origin, content)


def fence_items(fence: Fence, origin: Origin | None) -> tuple[MissionItem, ...]:
    """Return a fence as items; in degrees where `world` has a place on the globe."""
    commands = {inside: command for command, inside in _POLYGONS.items()}
    items = [
        _at(commands[polygon.keeps_in], float(len(polygon.corners)), corner, origin)
        for polygon in fence.polygons
        for corner in polygon.corners
    ]
    commands = {inside: command for command, inside in _CIRCLES.items()}
    items += [
        _at(commands[each.keeps_in], each.radius_m, (each.x_m, each.y_m), origin)
        for each in fence.circles
    ]
    return tuple(items)


def _at(command: int, param1: float, place: Point, origin: Origin | None) -> MissionItem:
    params = (param1, 0.0, 0.0, 0.0)
    if origin is None:
        return MissionItem(command, common.MAV_FRAME_LOCAL_NED, params, *ned_from_enu(*place), 0.0)
    x, y = origin.from_world(*place)
    return MissionItem(command, common.MAV_FRAME_GLOBAL, params, x, y, 0.0)


def check_fence_item(item: MissionItem, seq: int, origin: Origin | None) -> None:
    """Check a single item.

    Raises
    ------
    BadItem
        If it is none of a fence, or its place means nothing.
    """
    check_params(item, seq)
    if item.command == _RETURN:
        check_altitude(item, seq)
        return
    if item.command not in _POLYGONS and item.command not in _CIRCLES:
        why = f"command {item.command} is none of a fence"
        raise BadItem(seq, common.MAV_MISSION_UNSUPPORTED, why)
    bounded_place(item, seq, origin)
    first, group = item.params[:2]
    if item.command in _CIRCLES and not 0.0 < first < FARTHEST_M:
        raise BadItem(seq, _INVALID_1, f"radius {first:g} m found, above 0 allowed")
    if group not in {0.0} and not math.isnan(group):
        why = f"group {group:g} found, 0 allowed: the robot stays within all shapes"
        raise BadItem(seq, common.MAV_MISSION_INVALID_PARAM2, why)


def fence_of(items: Sequence[MissionItem], origin: Origin | None) -> tuple[FencePlan, list[str]]:
    """Return the fence of all items, with notes for people.

    Raises
    ------
    BadItem
        If a polygon has other corners than it says, or nothing bounds the robot.
    """
    polygons: list[FencePolygon] = []
    circles: list[FenceCircle] = []
    notes = []
    seq = 0
    while seq < len(items):
        item = items[seq]
        if item.command in _POLYGONS:
            corners = _corners(items, seq, origin)
            polygons.append(FencePolygon(corners, _POLYGONS[item.command]))
            seq += len(corners)
            continue
        if item.command in _CIRCLES:
            place = bounded_place(item, seq, origin)
            circles.append(FenceCircle(*place, item.params[0], _CIRCLES[item.command]))
        else:
            notes.append(f"item {seq}: the robot stops at the fence, and returns nowhere")
        seq += 1
    fence = Fence(tuple(polygons), tuple(circles))
    items = tuple(plain(item) for item in items)
    if fence.is_empty:
        raise BadItem(0, _INVALID, "nothing that bounds the robot")
    used = origin if any(each.is_global and each.command != _RETURN for each in items) else None
    content = msgspec.json.encode(_Kept(fence=fence, items=items, origin=used))
    return FencePlan(items, fence, used, content), notes


def plain(item: MissionItem) -> MissionItem:
    """Return an item without values that are no number, which JSON has not: they say nothing."""
    a, b, c, d = (0.0 if math.isnan(each) else each for each in item.params)
    return item._replace(params=(a, b, c, d), z=item.z if math.isfinite(item.z) else 0.0)


def _corners(items: Sequence[MissionItem], seq: int, origin: Origin | None) -> tuple[Point, ...]:
    """Return the corners of the polygon that begins with an item."""
    first = items[seq]
    said = first.params[0]
    if not (_FEWEST_CORNERS <= said <= len(items) and said == int(said)):
        raise BadItem(seq, _INVALID_1, f"{said:g} corners found, {_FEWEST_CORNERS} or more allowed")
    count = int(said)
    for offset in range(count):
        other = items[seq + offset] if seq + offset < len(items) else None
        if other is None or other.command != first.command or other.params[0] != said:
            why = f"a polygon of {count} corners has {offset}"
            raise BadItem(seq, _INVALID_1, why)
    return tuple(bounded_place(items[k], k, origin) for k in range(seq, seq + count))
