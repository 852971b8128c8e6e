"""The mission file that a MAVLink mission is kept in, with the items that it came in.

It is a mission file like any other; its first line, a comment, holds the items for whoever asks for
them.
"""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import astuple, dataclass
from typing import Final, NamedTuple

from robotctl.mavlink.globe import Origin
from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.translate import Translation, first_from
from robotctl.model.geometry.se2 import SE2

_MARK: Final = "# MAVLink: "


class UploadedMission(NamedTuple):
    """Content of the first line."""

    items: tuple[MissionItem, ...]
    sources: tuple[int, ...]
    """Number of the uploaded item that each item of ours comes from."""
    origin: Origin | None
    """Origin by which places on the globe became those of `world`; None: there are none."""


NOTHING: Final = UploadedMission((), (), None)


@dataclass(frozen=True, slots=True)
class MissionPlan:
    """A mission that came over MAVLink."""

    kept: UploadedMission = NOTHING
    content: bytes = b""
    """The mission file that was made of it."""

    @property
    def items(self) -> tuple[MissionItem, ...]:
        """Items as they came."""
        return self.kept.items

    @property
    def origin(self) -> Origin | None:
        """Origin by which places on the globe became those of `world`; None: there are none."""
        return self.kept.origin

    @property
    def sources(self) -> tuple[int, ...]:
        """Number of the uploaded item that each item of ours comes from."""
        return self.kept.sources

    @property
    def crc(self) -> int:
        """Checksum by which navigation names the mission; 0: none."""
        return zlib.crc32(self.content)

    def seq_of(self, item: int) -> int:
        """Return the number of the MAVLink item that an item of ours is from."""
        return self.sources[min(item, len(self.sources) - 1)]

    def first_of(self, seq: int) -> int | None:
        """Return the index of our first item from a MAVLink item on; None: there is none."""
        return first_from(self.sources, seq)


def mission_file(kept: UploadedMission, meaning: Translation, home: SE2) -> bytes:
    """Return the file."""
    origin = None if kept.origin is None else astuple(kept.origin)
    said = json.dumps((kept.items, kept.sources, origin), separators=(",", ":"))
    heading_deg = math.degrees(home.theta_rad)
    lines = [
        _MARK + said,
        'name = "mavlink"',
        'world = ""',
        f"start = {{ x_m = {home.x_m!r}, y_m = {home.y_m!r}, heading_deg = {heading_deg!r} }}",
    ]
    for item in meaning.items:
        lines += ["", "[[item]]", *(f"{key} = {_toml(value)}" for key, value in item.items())]
    return ("\n".join(lines) + "\n").encode()


def read_mission_file(content: bytes) -> UploadedMission | None:
    """Return what the first line says; None: it is no such file."""
    first = content.decode(errors="replace").partition("\n")[0]
    if not first.startswith(_MARK):
        return None
    try:
        items, sources, origin = json.loads(first.removeprefix(_MARK))
        return UploadedMission(
            tuple(
                MissionItem(command, frame, tuple(params), *rest)
                for command, frame, params, *rest in items
            ),
            tuple(sources),
            None if origin is None else Origin(*origin),
        )
    except (ValueError, TypeError):  # damaged
        return None


def _toml(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)
