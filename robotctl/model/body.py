"""The robot's body, as its file tells it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from robotctl.errors import InvalidValue
from robotctl.model.footprint import Footprint
from robotctl.model.polygons import Polygon, area

FARTHEST_M: Final = 10.0
"""Bound of the distance of a corner from `base`; beyond, a number is a slip [m]."""
OUTSIDE_M: Final = 0.01
"""A sensor may stand out by this [m]."""


@dataclass(frozen=True, slots=True)
class BodyPart:
    """Something that moves with the robot, beside the outline or in it.

    Parameters
    ----------
    name
        How it is called.
    outline
        Corners of a simple polygon, in order, either way round [m]; it may leave `base` outside.
    states
        States of the body in which it is there; none: it always is.

    Raises
    ------
    InvalidValue
        If the outline is no simple polygon.
    """

    name: str
    outline: Polygon
    states: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the outline here, so that an error names this part."""
        _check_reach(self.outline)
        try:
            Footprint(_AROUND_BASE, (_to_the_left(self.outline),))
        except ValueError as error:
            raise InvalidValue("outline", str(error), self.outline) from error


@dataclass(frozen=True, slots=True)
class BodyConfig:
    """The outline of all that moves with the robot.

    Parameters
    ----------
    outline
        Corners of a simple polygon around `base`, in order, either way round [m]. Without any, the
        body is a rectangle around nose and sonars, of `nose_m` and `half_width_m` of
        `[navigation.guard]`.
    states
        Names of its states, such as with and without a load; parts may be there in some only.
    state
        Present state of the body, by its place in `states` from 0 on.
    part
        What belongs to the body beside that.

    Raises
    ------
    InvalidValue
        If the outline is none, or `base` outside of it, or there is no such state.
    """

    outline: Polygon = ()
    states: tuple[str, ...] = ()
    state: int | None = None
    part: tuple[BodyPart, ...] = ()

    def __post_init__(self) -> None:
        """Check the outline, and the states."""
        _check_reach(self.outline)
        try:
            Footprint(_to_the_left(self.outline))
        except ValueError as error:
            raise InvalidValue("outline", str(error), self.outline) from error
        if self.part and not self.outline:
            rule = "missing, but needed beside parts"
            raise InvalidValue("outline", rule, self.outline)
        names = [part.name for part in self.part]
        if len(set(names)) < len(names):
            raise InvalidValue("part", f"two have the same name: {', '.join(names)}", names)
        self._check_states()

    def _check_states(self) -> None:
        """Raise InvalidValue if there is no such state as the present one."""
        states = self.states
        if len(set(states)) < len(states):
            raise InvalidValue("states", f"two have the same name: {', '.join(states)}", states)
        if self.state is not None and not states:
            raise InvalidValue("states", "missing, but needed beside a state", states)
        if states and self.state is None:
            raise InvalidValue("state", "missing, but needed beside states", self.state)
        if self.state is not None and not 0 <= self.state < len(states):
            allowed = ", ".join(f"{i} ({name})" for i, name in enumerate(states))
            raise InvalidValue("state", f"{self.state} found; allowed are {allowed}", self.state)

    @property
    def footprint(self) -> Footprint | None:
        """The outline with all parts that are there now; None if there is none."""
        return self._in(self.states[self.state] if self.state is not None else "")

    @property
    def footprints(self) -> tuple[Footprint, ...]:
        """The outline with its parts in each state, or the only one; none if there is none."""
        found = map(self._in, self.states or ("",))
        return tuple(each for each in found if each is not None)

    def _in(self, state: str) -> Footprint | None:
        """Return the outline with the parts of a state; None if there is none."""
        parts = (part for part in self.part if not part.states or state in part.states)
        corners = tuple(_to_the_left(part.outline) for part in parts)
        return Footprint(_to_the_left(self.outline), corners) if self.outline else None


_AROUND_BASE: Final = ((1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0))


def _check_reach(corners: Polygon) -> None:
    """Raise InvalidValue for a corner that is too far away."""
    if not all(math.hypot(*corner) <= FARTHEST_M for corner in corners):
        problem = f"a corner farther than {FARTHEST_M:g} m from base, or no number"
        raise InvalidValue("outline", problem, corners)


def _to_the_left(corners: Polygon) -> Polygon:
    """Return the corners of an outline counter-clockwise."""
    return corners if area(corners) >= 0.0 else corners[::-1]
