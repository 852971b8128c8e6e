"""The order in which a mission's items are driven: repeats and jumps, and their counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from robotctl.planning.behave.behaviours.flow import FlowItem, JumpItem, RepeatItem, Target
from robotctl.planning.behave.behaviours.item import Item
from robotctl.planning.behave.behaviours.registry import kind_of
from robotctl.toml_source import nearest


class ItemProblem(NamedTuple):
    """Error in an item: its index, the key to blame, and the reason."""

    item: int
    key: str
    why: str


class Loop(NamedTuple):
    """A repeat or jump of one mission."""

    target: int
    """Index of the item that it leads to."""
    most: int | None
    """How often it leads there; None: always."""
    anew: bool
    """Whether its count starts again once it was passed."""
    passes: bool
    """Whether people count how often its block was driven, not how often it led back."""


def item_index(items: Sequence[Item], wanted: Target) -> int:
    """Return the index of an item by number, counted from 1, or by name.

    Raises
    ------
    ValueError
        With the nearest name, or the numbers that there are.
    """
    if isinstance(wanted, int):
        if not 1 <= wanted <= len(items):
            raise ValueError(f"{wanted} found; the mission has items 1 to {len(items)}")
        return wanted - 1
    found = [index for index, item in enumerate(items) if item.name == wanted]
    if not found:
        hint = nearest(wanted, [item.name for item in items if item.name])
        raise ValueError(f'no item has the name "{wanted}"{hint}')
    if len(found) > 1:
        numbers = " and ".join(str(index + 1) for index in found)
        raise ValueError(f'items {numbers} have the name "{wanted}"; use the number')
    return found[0]


def flow_problems(items: Sequence[Item]) -> Iterator[ItemProblem]:
    """Yield why a mission's repeats and jumps cannot be followed."""
    loops, is_whole = {}, True
    for index, item in enumerate(items):
        if isinstance(item, FlowItem):
            try:
                loops[index] = _loop_of(items, index, item)
            except ValueError as error:
                is_whole = False
                yield ItemProblem(index, _key(item), str(error))
    if is_whole:
        yield from _motionless(items, loops)


def _motionless(items: Sequence[Item], loops: dict[int, Loop]) -> Iterator[ItemProblem]:
    """Yield endless rounds in which no item drives.

    What leads back a limited number of times is passed in the end, so each item has one successor
    in the long run, and a mission without end runs into one round of them.
    """
    after = [
        loops[index].target if index in loops and loops[index].most is None else index + 1
        for index in range(len(items))
    ]
    walk_of: dict[int, int] = {}
    """Beginning of the walk that came to an item first."""
    for begin in range(len(items)):
        at, walk = begin, list[int]()
        while at < len(items) and at not in walk_of:
            walk_of[at] = begin
            walk.append(at)
            at = after[at]
        cycle = walk[walk.index(at) :] if walk_of.get(at) == begin else []
        if cycle and not any(_drives(items[index]) for index in cycle):
            last = max(index for index in cycle if index in loops)
            why = "needed here: the items between go on without end, and none of them drives"
            yield ItemProblem(last, "times", why)


def _drives(item: Item) -> bool:
    kind = kind_of(item)
    return kind is not None and kind.drives


def _key(item: FlowItem) -> str:
    return "first" if isinstance(item, RepeatItem) else "to"


def _loop_of(items: Sequence[Item], index: int, item: FlowItem) -> Loop:
    """Return where an item leads; `ValueError`: nowhere."""
    if isinstance(item, JumpItem):
        return Loop(item_index(items, item.to), item.times, anew=False, passes=False)
    target = item_index(items, item.first)
    if target >= index:
        raise ValueError(f"item {target + 1} found; an item before this one is needed")
    most = None if item.times is None else item.times - 1
    return Loop(target, most, anew=True, passes=True)


class MissionFlow:
    """Leads from item to item, and counts how often each repeat and jump was taken.

    Parameters
    ----------
    items
        Of the mission; without `flow_problems`.
    """

    def __init__(self, items: Sequence[Item]) -> None:
        self._loops = {
            index: _loop_of(items, index, item)
            for index, item in enumerate(items)
            if isinstance(item, FlowItem)
        }
        self.reset()

    def reset(self) -> None:
        """Count from nothing."""
        self._counts = dict.fromkeys(self._loops, 0)

    @property
    def counts(self) -> tuple[int, ...]:
        """How often each repeat and jump was taken, in the order of the items."""
        return tuple(self._counts.values())

    def resume(self, counts: Sequence[int]) -> None:
        """Go on with the counts of an earlier run.

        Raises
        ------
        ValueError
            If they are not of these items.
        """
        if len(counts) != len(self._loops):
            raise ValueError(f"{len(self._loops)} counts of repeats needed, not {len(counts)}")
        self._counts = dict(zip(self._loops, counts, strict=True))

    def leads(self, index: int) -> bool:
        """Say whether an item is a repeat or jump."""
        return index in self._loops

    def follow(self, index: int) -> int:
        """Return the item to go on with from a repeat or jump, and count it."""
        loop = self._loops[index]
        if loop.most is None or self._counts[index] < loop.most:
            self._counts[index] += 1
            return loop.target
        if loop.anew:
            self._counts[index] = 0
        return index + 1

    def told(self, index: int) -> str:
        """Return how far a repeat or jump is, such as `2 of 3`; empty: not begun."""
        loop, count = self._loops[index], self._counts[index]
        if not count:
            return ""
        of = "" if loop.most is None else f" of {loop.most + loop.passes}"
        return f"{count + loop.passes}{of}"
