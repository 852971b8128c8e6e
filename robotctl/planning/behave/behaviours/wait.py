"""The behaviour that stands still."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    Stopwatch,
    done,
)
from robotctl.planning.behave.behaviours.item import require_positive
from robotctl.planning.behave.behaviours.kind import Kind, NavigatedRobot


@dataclass(frozen=True, slots=True)
class WaitItem:
    """Stand still.

    Parameters
    ----------
    kind
        Always "wait".
    duration_s
        How long [s], > 0.
    name
        Name shown to people.
    """

    kind: Literal["wait"]
    duration_s: float
    name: str = ""

    def __post_init__(self) -> None:
        require_positive(self, "duration_s")


class Wait(Behaviour):
    """Stands still for a time [s]."""

    def __init__(self, duration_s: float) -> None:
        self._duration_ns = round(duration_s * 1e9)
        self.reset()

    def reset(self) -> None:
        """Begin to wait with the next step."""
        self._watch = Stopwatch()

    def pause(self) -> None:
        """Keep the time waited."""
        self._watch.pause()

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return a stop; done when the time is over."""
        left_ns = self._duration_ns - self._watch.step(now_ns)
        return (
            done()
            if left_ns <= 0
            else BehaviourOutput(0.0, 0.0, text=f"{left_ns / 1e9:.0f} s to wait")
        )


def _make(item: WaitItem, robot: NavigatedRobot) -> Wait:  # noqa: ARG001 - as of all kinds
    return Wait(item.duration_s)


WAIT = Kind(_make, drives=False)
