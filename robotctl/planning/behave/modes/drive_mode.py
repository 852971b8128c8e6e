"""Steering of the robot in one of its modes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

from robotctl.messages.mode import Mode
from robotctl.model.fence import Point
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput

BY_HAND: Final = frozenset({Mode.HOLD, Mode.MANUAL})
"""The modes without autonomous motion."""


class DriveMode(ABC):
    """Steers the robot while it is in one mode."""

    @property
    def is_under_way(self) -> bool:
        """Whether it drives to somewhere in the world: what is done does not set off again."""
        return False

    @property
    def goal(self) -> Point | None:
        """Place in `world` that it drives to now [m]; None: no known place."""
        return None

    @property
    def expires_ns(self) -> int | None:
        """Time at which a received velocity expires [ns]; None: the mode steers by none."""
        return None

    @abstractmethod
    def begin(self) -> None:
        """Enter the mode, or start it over."""

    def pause(self) -> None:  # noqa: B027 - nothing to do without a behaviour
        """Stop the behaviour under way, and its time: something else steers for a while."""

    def relocate(self) -> None:  # noqa: B027 - nothing to do without a behaviour
        """Return to where it was interrupted: the robot has lost its pose, and finds it again."""

    @abstractmethod
    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:
        """Return the velocity at `now_ns`, monotonic [ns]."""
