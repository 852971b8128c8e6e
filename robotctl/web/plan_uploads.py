"""Missions, fences and zones that a page sends: read, checked, and put as requests to navigation.

They come by POST, since a mission may be longer than any message of the page's socket, whose limit
keeps a client from flooding it.
"""

from __future__ import annotations

import math
import tomllib
import zlib
from typing import Annotated, Any, Final, NamedTuple, Protocol, TypeAlias

import msgspec
from msgspec import Meta

from robotctl.errors import ConfigError
from robotctl.messages.fence import FenceFile, SetFence
from robotctl.messages.mission import LoadMission
from robotctl.messages.plans import DrawnZone, SetZones, ZonesFile
from robotctl.messages.requests import FARTHEST_M
from robotctl.model.fence import Fence, FenceCircle, FencePolygon, Point
from robotctl.web.wire import Number, Time

MAX_PLAN_BYTES: Final = 1 << 17
"""Longest body of a POST with a plan: a mission of 1000 items has half of it."""
MOST_SHAPES: Final = 200
MOST_CORNERS: Final = 200
MOST_ITEMS: Final = 1000
"""Most items of a mission, as over MAVLink."""
FASTEST_M_S: Final = 100.0
NAME: Final = "mission.toml"

PlanRequest: TypeAlias = LoadMission | SetFence | SetZones


class PlanStore(Protocol):
    """Storage in which plans of one kind outlive a restart."""

    def save(self, content: bytes) -> str:
        """Save a file beside the present one; return its path, empty: it is not kept."""

    def keep(self, content: bytes) -> None:
        """Remove all that was saved but this."""


class PlanUpload(msgspec.Struct, frozen=True, tag=True, forbid_unknown_fields=True):
    """Any plan: the page's connection on `/live`, its number of the request, and its time."""

    client: Number
    id: Number
    at_ms: Time


class MissionUpload(PlanUpload, frozen=True):
    """A mission file; empty: the robot is to have no mission."""

    text: str


class FenceUpload(PlanUpload, frozen=True):
    """A fence; without shapes: none."""

    polygons: Annotated[tuple[FencePolygon, ...], Meta(max_length=MOST_SHAPES)]
    circles: Annotated[tuple[FenceCircle, ...], Meta(max_length=MOST_SHAPES)]


class ZonesUpload(PlanUpload, frozen=True):
    """All drawn zones."""

    zones: Annotated[tuple[DrawnZone, ...], Meta(max_length=MOST_SHAPES)]


AnyUpload: TypeAlias = MissionUpload | FenceUpload | ZonesUpload

_decode = msgspec.json.Decoder(AnyUpload).decode


class Offered(NamedTuple):
    """A plan for navigation."""

    kind: str
    """Name of its store."""
    content: bytes
    """File that it is kept in; empty: none of the kind any more."""
    request: PlanRequest
    crc: int
    """CRC-32 by which navigation names it, 0 for none."""
    file: str = ""
    """Path of the file; empty: it is in none."""


class BadPlan(Exception):  # noqa: N818 - what it is, not that it went wrong
    """A plan that the robot cannot have, in words."""


def read_upload(body: bytes) -> AnyUpload:
    """Return what a page has sent.

    Raises
    ------
    BadPlan
        If it is none of the plans.
    """
    try:
        upload: AnyUpload = _decode(body)
    except (msgspec.DecodeError, UnicodeError, RecursionError, OverflowError) as error:
        raise BadPlan(str(error)) from None
    return upload


def offered(upload: AnyUpload, stamp_ns: int) -> Offered:
    """Return a plan as a request of a time.

    Raises
    ------
    BadPlan
        If it is wrong: with the line of a mission's file, the number of a shape.
    """
    match upload:
        case MissionUpload(text=text):
            content = text.encode(errors="replace")
            if content:
                _check_mission(text)
            return Offered(
                "mission", content, LoadMission(stamp_ns, "", content), zlib.crc32(content)
            )
        case FenceUpload(polygons=polygons, circles=circles):
            for number, polygon in enumerate(polygons, 1):
                _check_corners(f"polygon {number}", polygon.corners)
            for number, circle in enumerate(circles, 1):
                _check_place(f"circle {number}", (circle.x_m, circle.y_m))
                if not 0.0 < circle.radius_m < FARTHEST_M:
                    raise BadPlan(f"circle {number}: radius {circle.radius_m:g} m, above 0 allowed")
            fence = Fence(polygons, circles)
            content = b"" if fence.is_empty else msgspec.json.encode(FenceFile(fence))
            crc = zlib.crc32(content)
            return Offered("fence", content, SetFence(stamp_ns, fence, crc), crc)
        case ZonesUpload(zones=zones):
            for zone in zones:
                _check_zone(zone)
            zones = tuple(msgspec.structs.replace(each, origin="map") for each in zones)
            content = msgspec.json.encode(ZonesFile(zones)) if zones else b""
            crc = zlib.crc32(content)
            return Offered("zones", content, SetZones(stamp_ns, zones, crc), crc)


def mission_tree(body: bytes) -> dict[str, Any]:
    """Return the tables of a mission file.

    Raises
    ------
    BadPlan
        If it is no TOML: with the line.
    """
    try:
        return tomllib.loads(body.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise BadPlan(f"not valid TOML: {error}") from None


def _check_mission(text: str) -> None:
    """Check a mission's file, as `robotctl mission run` does."""
    # pydantic builds its validators.
    from robotctl.planning.behave.mission.mission_file import parse_mission  # noqa: PLC0415

    try:
        mission = parse_mission(text, NAME)
    except (ConfigError, ValueError, RecursionError) as error:
        raise BadPlan(str(error)) from None
    if len(mission.item) > MOST_ITEMS:
        raise BadPlan(f"{NAME}: {len(mission.item)} items found, at most {MOST_ITEMS} allowed")


def _check_zone(zone: DrawnZone) -> None:
    if not 0 < len(zone.name) <= _LONGEST_NAME:
        raise BadPlan(f"a zone's name has {len(zone.name)} letters, 1 to {_LONGEST_NAME} allowed")
    _check_corners(f"zone {zone.name}", zone.corners)
    if not 0.0 <= zone.speed_m_s <= FASTEST_M_S:
        raise BadPlan(
            f"zone {zone.name}: {zone.speed_m_s:g} m/s found, 0 to {FASTEST_M_S:g} allowed"
        )


def _check_corners(what: str, corners: tuple[Point, ...]) -> None:
    if not _FEWEST_CORNERS <= len(corners) <= MOST_CORNERS:
        raise BadPlan(
            f"{what}: {len(corners)} corners found, {_FEWEST_CORNERS} to {MOST_CORNERS} allowed"
        )
    for corner in corners:
        _check_place(what, corner)


def _check_place(what: str, place: Point) -> None:
    for value in place:
        if not (math.isfinite(value) and abs(value) < FARTHEST_M):
            raise BadPlan(f"{what}: {value:g} m away, less than {FARTHEST_M:g} allowed")


_FEWEST_CORNERS: Final = 3
_LONGEST_NAME: Final = 60
