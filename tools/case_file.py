"""Campaign files of cases, `[[case]]`, as `robotctl campaign` reads them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit


def write_cases(file: Path, cases: Iterable[Mapping[str, Any]]) -> None:
    """Write a campaign of some cases."""
    file.write_text(tomlkit.dumps({"case": [dict(each) for each in cases]}), encoding="utf-8")


def write_mission(
    file: Path, world: str, start: Sequence[float], goal: Sequence[float], name: str
) -> None:
    """Write a mission of one goal.

    Parameters
    ----------
    file
        Its file.
    world
        Name or file of its world, seen from the mission.
    start
        x, y, heading [m, m, deg].
    goal
        x, y [m].
    name
        Name of the mission.
    """
    content = {
        "name": name,
        "world": world,
        "start": dict(zip(("x_m", "y_m", "heading_deg"), start, strict=True)),
        "item": [{"kind": "goto", "x_m": goal[0], "y_m": goal[1]}],
    }
    file.write_text(tomlkit.dumps(content), encoding="utf-8")
