"""Mission items that say which item is next: repeats of a block, and jumps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from robotctl.errors import InvalidValue

Target: TypeAlias = int | str
"""An item: its number in the mission, counted from 1, or its name."""


@dataclass(frozen=True, slots=True)
class RepeatItem:
    """End a block of items that is driven several times. Repeats may be nested.

    Parameters
    ----------
    kind
        Always "repeat".
    first
        The item that the block begins with, before this one.
    times
        How often the block is driven in all, >= 1; None: without end.
    name
        Name shown to people.
    """

    kind: Literal["repeat"]
    first: Target = 1
    times: int | None = None
    name: str = ""

    def __post_init__(self) -> None:
        _require_count(self.times)


@dataclass(frozen=True, slots=True)
class JumpItem:
    """Go on with another item, before or after this one.

    Parameters
    ----------
    kind
        Always "jump".
    to
        The item to go on with.
    times
        How often in the whole mission, >= 1; then it is passed. None: always.
    name
        Name shown to people.
    """

    kind: Literal["jump"]
    to: Target
    times: int | None = None
    name: str = ""

    def __post_init__(self) -> None:
        _require_count(self.times)


FlowItem: TypeAlias = RepeatItem | JumpItem


def _require_count(times: int | None) -> None:
    if times is not None and times < 1:
        raise InvalidValue("times", f"must be at least 1, not {times}", times)
