"""Tables `[[motor]]` for the drives that a scan has found, to be copied into a robot's file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

from robotctl.drivers.can.probe import Found

WHEELS: Final = ("left", "right", "rear_left", "rear_right")
"""Names of wheels where no robot's file says others."""


def motor_tables(found: Iterable[Found], wheels: Sequence[str] = WHEELS, bus: str = "") -> str:
    """Return the tables of all motor drives as TOML; empty where there is none.

    Parameters
    ----------
    found
        What a scan has found.
    wheels
        Names of the robot's wheels, which are given to the axes in their order: which of them a
        drive turns, and in which direction, its owner has to see.
    bus
        Name of the bus; empty: the first.
    """
    names = _names(wheels)
    return "\n".join(_table(each, names, bus) for each in found if each.kind)


def _names(wheels: Sequence[str]) -> Iterator[str]:
    """Yield the wheels, then further names."""
    yield from wheels
    number = len(wheels)
    while True:
        number += 1
        yield f"wheel_{number}"


def _table(found: Found, wheels: Iterator[str], bus: str) -> str:
    """Return the table of one drive."""
    has_number = found.kind != "native"  # ours is always node 1
    name = f"{found.kind}_{found.number}" if has_number else "drive"
    keys: dict[str, Any] = {"kind": found.kind, "name": name}
    if bus:
        keys["bus"] = bus
    if has_number:
        keys["node_id"] = found.number
    axes = ", ".join(
        f'{{ actuator = "{next(wheels)}"{f", axis = {axis}" if found.axes > 1 else ""} }}'
        for axis in range(1, found.axes + 1)
    )
    lines = [f"# {each}" for each in (_words(found), *found.hints) if each]
    lines.append("[[motor]]")
    lines += [f"{key} = {_toml(value)}" for key, value in (*keys.items(), *found.keys.items())]
    lines.append(f"axes = [{axes}]")
    return "\n".join(lines) + "\n"


def _words(found: Found) -> str:
    """Return what is known of a drive, in a line."""
    firmware = f"firmware {found.firmware}" if found.firmware else ""
    return ", ".join(
        each for each in (f"{found.protocol} {found.number}", found.name, firmware) if each
    )


def _toml(value: Any) -> str:
    """Return a text, a number or a truth value as TOML, which writes these as JSON does."""
    return json.dumps(value, ensure_ascii=False)
