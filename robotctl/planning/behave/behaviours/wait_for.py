"""The behaviour that stands until something is so."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from robotctl.errors import InvalidValue
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
    failed,
)
from robotctl.planning.behave.behaviours.item import require_positive
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot
from robotctl.planning.guard.obstacle_guard import ObstacleGuard

_CLEAR_NS: Final = 1_000_000_000
"""The way ahead counts as clear after being so for this long [ns]: people walk in groups."""


@dataclass(frozen=True, slots=True)
class WaitForItem:
    """Stand until all that is asked for is so.

    Parameters
    ----------
    kind
        Always "wait_for".
    clear_ahead_m
        Nothing stands on the way straight ahead for this long [m], > 0.
    charge_percent
        The battery is charged to this at least [%], in (0, 100].
    go_ahead
        An operator says so: `robotctl mission resume`.
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0; None: never.
    """

    kind: Literal["wait_for"]
    clear_ahead_m: float | None = None
    charge_percent: float | None = None
    go_ahead: bool = False
    name: str = ""
    time_out_s: float | None = None

    def __post_init__(self) -> None:
        require_positive(self, "clear_ahead_m", "charge_percent", "time_out_s")
        if self.charge_percent is not None and self.charge_percent > 100.0:
            rule = f"must be above 0 and at most 100, not {self.charge_percent}"
            raise InvalidValue("charge_percent", rule, self.charge_percent)
        if self.clear_ahead_m is None and self.charge_percent is None and not self.go_ahead:
            raise ValueError("one of clear_ahead_m, charge_percent and go_ahead is needed")


class WaitFor(Behaviour):
    """Stands until all conditions of its item are met.

    Parameters
    ----------
    item
        With the conditions.
    guard
        Knows what is ahead.
    """

    def __init__(self, item: WaitForItem, guard: ObstacleGuard) -> None:
        self._item = item
        self._guard = guard
        self.reset()

    def reset(self) -> None:
        """Wait for all of it again."""
        self._told = False
        self.pause()

    def pause(self) -> None:
        """Keep an operator's word; check again whether the way is free."""
        self._clear_ns: int | None = None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return a stop, with what is waited for; done when nothing is left."""
        self._told |= situation.go_ahead
        if self._item.clear_ahead_m is not None and not self._guard.sees_ahead:
            return failed("no sonar or lidar of this robot looks ahead")
        left = [
            *self._way(self._item.clear_ahead_m, now_ns),
            *self._charge(self._item.charge_percent, situation.charge),
            *(["the go-ahead of an operator"] if self._item.go_ahead and not self._told else []),
        ]
        return BehaviourOutput(0.0, 0.0, text=f"waits for {', '.join(left)}") if left else done()

    def _way(self, wanted_m: float | None, now_ns: int) -> list[str]:
        """Return what is to be said of the way ahead; nothing where it is clear."""
        if wanted_m is None:
            return []
        free_m, obstacle = self._guard.free_ahead()
        if free_m < wanted_m:
            self._clear_ns = None
            return [f"{wanted_m:g} m of free way ahead ({obstacle})"]
        self._clear_ns = now_ns if self._clear_ns is None else self._clear_ns
        if now_ns - self._clear_ns >= _CLEAR_NS:
            return []
        return [f"{wanted_m:g} m of free way ahead to stay so"]

    @staticmethod
    def _charge(wanted_percent: float | None, charge: float) -> list[str]:
        """Return what is to be said of the battery; nothing where it is full enough."""
        if wanted_percent is None or 100.0 * charge >= wanted_percent:
            return []
        now = "unknown" if math.isnan(charge) else f"{100.0 * charge:.0f} % now"
        return [f"a charge of {wanted_percent:g} % ({now})"]


def _make(item: WaitForItem, robot: NavigatedRobot) -> WaitFor:
    return WaitFor(item, robot.guard)


def _time_out_s(item: WaitForItem) -> float | None:
    return item.time_out_s


WAIT_FOR = Kind(_make, _time_out_s, drives=False)
