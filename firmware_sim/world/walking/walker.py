"""Common base of all walkers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

Place: TypeAlias = tuple[float, float]
"""Place in world: x, y [m]."""

RADIUS_M: Final = 0.22
ROOM_M: Final = 0.08
"""Clearance that people keep from walls [m]."""
STEP_NS: Final = 10_000_000
STEP_S: Final = STEP_NS * 1e-9
LOOK_STEPS: Final = 10
LOOK_S: Final = LOOK_STEPS * STEP_S
"""Time between two looks of who looks about [s]."""


class Mover(NamedTuple):
    """A disc that others see move: centre [m], velocity [m/s], radius [m].

    `evades` tells whether it does half of the evading.
    """

    x_m: float
    y_m: float
    vx_m_s: float
    vy_m_s: float
    radius_m: float
    evades: bool = False


class Walker(ABC):
    """Person who walks in steps of `STEP_NS`.

    Attributes
    ----------
    place
        Where the last step ended.
    stands_ns
        Time until which who met the robot stands [ns].
    touches
        Whether a contact with the robot is not over yet.
    """

    __slots__ = ("place", "stands_ns", "touches")

    looks = False
    """Whether it looks at others."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.stands_ns = 0
        self.touches = False

    def look(self, others: Sequence[Mover]) -> None:  # noqa: B027 - most look at nobody
        """Choose a velocity for the next `LOOK_S`, by what all others do."""

    @abstractmethod
    def ahead(self) -> Place:
        """Return where the next step would end."""

    @abstractmethod
    def go(self, ahead: Place) -> None:
        """Do the step that `ahead` returned."""

    @abstractmethod
    def turn_round(self) -> None:
        """Go back, after a contact with the robot."""
