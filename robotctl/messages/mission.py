"""Requests to a running robot: its mission, exploration, places."""

from __future__ import annotations

from typing import TypeAlias

import msgspec


class LoadMission(msgspec.Struct, frozen=True, tag=True):
    """Replace the mission that mode AUTO drives.

    `content` is the mission as TOML, `file` the absolute path of its file, empty without one; empty
    content removes the mission.
    """

    stamp_ns: int
    file: str
    content: bytes


class GoAhead(msgspec.Struct, frozen=True, tag=True):
    """Continue a mission that waits for an operator's go-ahead."""

    stamp_ns: int


class JumpToItem(msgspec.Struct, frozen=True, tag=True):
    """Continue with another item of the mission: its number, counted from 1, or its name."""

    stamp_ns: int
    item: int | str


class AbortMission(msgspec.Struct, frozen=True, tag=True):
    """Abort the mission: the robot stands, and AUTO would start it from the beginning."""

    stamp_ns: int


class ExploreTarget(msgspec.Struct, frozen=True, tag=True):
    """GUIDED: explore unknown space until the map is complete."""

    stamp_ns: int


class PlaceTarget(msgspec.Struct, frozen=True, tag=True):
    """GUIDED: drive to a place of the topological map; `start` is the present place, if known."""

    stamp_ns: int
    place: str
    start: str = ""


MissionCommand: TypeAlias = (
    LoadMission | GoAhead | JumpToItem | AbortMission | ExploreTarget | PlaceTarget
)
