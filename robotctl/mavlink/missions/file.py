"""The mission file that a MAVLink mission is kept in, with the items that it came in.

It is a mission file like any other; its first line, a comment, holds the items for whoever asks for
them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Final

from robotctl.mavlink.missions.item import MissionItem
from robotctl.mavlink.missions.translate import Translation
from robotctl.model.geometry.se2 import SE2

_MARK: Final = "# MAVLink: "


def mission_file(items: Sequence[MissionItem], meaning: Translation, home: SE2) -> bytes:
    """Return the file."""
    kept = json.dumps({"items": items, "sources": meaning.sources}, separators=(",", ":"))
    heading_deg = math.degrees(home.theta_rad)
    lines = [
        _MARK + kept,
        'name = "mavlink"',
        'world = ""',
        f"start = {{ x_m = {home.x_m!r}, y_m = {home.y_m!r}, heading_deg = {heading_deg!r} }}",
    ]
    for item in meaning.items:
        lines += ["", "[[item]]", *(f"{key} = {_toml(value)}" for key, value in item.items())]
    return ("\n".join(lines) + "\n").encode()


def read_mission_file(
    content: bytes,
) -> tuple[tuple[MissionItem, ...], tuple[int, ...]] | None:
    """Return the items of MAVLink, and from which of them each of ours is; None: it has none."""
    first = content.decode(errors="replace").partition("\n")[0]
    if not first.startswith(_MARK):
        return None
    try:
        kept = json.loads(first.removeprefix(_MARK))
        items = tuple(
            MissionItem(command, frame, tuple(params), *rest)
            for command, frame, params, *rest in kept["items"]
        )
        return items, tuple(kept["sources"])
    except (ValueError, KeyError, TypeError):
        return None


def _toml(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)
