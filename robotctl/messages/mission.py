"""Requests to a running robot: for its mission, to explore, to drive to a place."""

from __future__ import annotations

from typing import TypeAlias

import msgspec


class LoadMission(msgspec.Struct, frozen=True, tag=True):
    """Take another mission in place of the present one; mode AUTO then drives it.

    `content` is that of the file, whose absolute path is `file`, empty if it is in none; without
    content the robot has no mission any more.
    """

    stamp_ns: int
    file: str
    content: bytes


class GoAhead(msgspec.Struct, frozen=True, tag=True):
    """Go on with a mission that waits for an operator's word."""

    stamp_ns: int


class JumpToItem(msgspec.Struct, frozen=True, tag=True):
    """Go on with another item of the mission: its number, counted from 1, or its name."""

    stamp_ns: int
    item: int | str


class AbortMission(msgspec.Struct, frozen=True, tag=True):
    """Give up the mission: the robot stands, and AUTO would start it again."""

    stamp_ns: int


class ExploreTarget(msgspec.Struct, frozen=True, tag=True):
    """GUIDED: drive to what is unknown until the map is complete."""

    stamp_ns: int


class PlaceTarget(msgspec.Struct, frozen=True, tag=True):
    """GUIDED: drive to a place of the topological map; `start` is where the robot is, if known."""

    stamp_ns: int
    place: str
    start: str = ""


MissionCommand: TypeAlias = (
    LoadMission | GoAhead | JumpToItem | AbortMission | ExploreTarget | PlaceTarget
)
