"""Input and output of a global planner: a path, or the reason why there is none."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.planning.map.planning_map import PlanningMap
from robotctl.planning.path.global_planning.grid_search import Corners

_STEP_RAD: Final = 0.1
"""Maximum turn from one pose of a densified path to the next [rad]."""

Point: TypeAlias = tuple[float, float]
Steering: TypeAlias = Literal["straight", "dubins", "reeds-shepp"]
GoesOn: TypeAlias = Callable[[], bool]
"""Asked now and then whether there is time left."""


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    """How paths are chosen.

    Parameters
    ----------
    margin_m
        Kept between the body and obstacles [m], >= 0.
    comfort_m
        Nearer to an obstacle than this beyond the margin, a path counts longer [m], >= 0.
    comfort_weight
        Cost factor at the margin itself, >= 0.
    corners
        How many of the two cells beside a diagonal step must be free.
    any_angle
        Whether a path over cells is straightened.
    turning_radius_m
        Of the robot's smallest circle, for planners of robots that steer [m], > 0.
    steering
        Motions of the random trees: straight pieces for a robot that turns on the spot, or curves
        of one that steers, only forwards (dubins) or in both gears (reeds-shepp).
    seed
        Of planners that draw random samples.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    margin_m: float = 0.05
    comfort_m: float = 0.25
    comfort_weight: float = 2.0
    corners: Corners = "both"
    any_angle: bool = True
    turning_radius_m: float = 0.5
    steering: Steering = "straight"
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the ranges."""
        for key in ("margin_m", "comfort_m", "comfort_weight"):
            if not 0.0 <= getattr(self, key) < math.inf:
                raise ValueError(f"{key} must be finite and >= 0, found {getattr(self, key)}")
        if not 0.0 < self.turning_radius_m < math.inf:
            raise ValueError(f"turning_radius_m must be above 0, found {self.turning_radius_m}")


class Reason(enum.Enum):
    """Why there is no plan."""

    START_OFF_MAP = "start_off_map"
    GOAL_OFF_MAP = "goal_off_map"
    START_BLOCKED = "start_blocked"
    GOAL_BLOCKED = "goal_blocked"
    NO_PASSAGE = "no_passage"
    ONLY_THROUGH_UNKNOWN = "only_through_unknown"
    NOT_FOUND = "not_found"
    OUT_OF_TIME = "out_of_time"


@dataclass(frozen=True, slots=True)
class PlanFailure:
    """Why there is no path.

    Parameters
    ----------
    reason, text
        For programs, and for people.
    place
        In `world`, where it fails [m]; None if no one place is to blame.
    expanded
        Cells, or nodes of a tree, that were looked at.
    """

    reason: Reason
    text: str
    place: Point | None = None
    expanded: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A path.

    Parameters
    ----------
    poses
        (n, 3) of `base` in `world` [m, m, rad], from the start to the goal. Between two poses the
        robot drives straight, or on the arc that joins them where the planner knows arcs.
    cost
        The planner's minimised cost [m]: the length plus penalties.
    expanded
        Cells, or nodes of a tree, that were looked at.
    reverse
        (n - 1,): whether the piece from each pose to the next is driven backwards; empty: none is.
    """

    poses: NDArray[np.float64]
    cost: float
    expanded: int
    reverse: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))

    def __post_init__(self) -> None:
        """Drive forwards where the planner says nothing of it."""
        if len(self.reverse) == 0:
            count = max(len(self.poses) - 1, 0)
            object.__setattr__(self, "reverse", np.zeros(count, np.bool_))

    @property
    def length_m(self) -> float:
        """Length of the path [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


def joined(plans: Sequence[Plan]) -> Plan:
    """Return plans one after the other, each of which begins where the one before ends."""
    return Plan(
        np.concatenate([plans[0].poses, *(each.poses[1:] for each in plans[1:])]),
        sum(each.cost for each in plans),
        sum(each.expanded for each in plans),
        np.concatenate([each.reverse for each in plans]),
    )


def dense(poses: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Return a path with poses in between, (n, 3), a step or 0.1 rad apart at most."""
    ways = np.diff(poses, axis=0)
    ways[:, 2] -= math.tau * np.round(ways[:, 2] / math.tau)
    steps = np.maximum(np.hypot(*ways[:, :2].T) / step_m, np.abs(ways[:, 2]) / _STEP_RAD)
    counts = np.ceil(np.maximum(steps, 1.0)).astype(np.int64)
    piece = np.repeat(np.arange(len(ways)), counts)
    numbers = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    between = poses[piece] + (numbers / counts[piece])[:, np.newaxis] * ways[piece]
    return np.concatenate([poses[:1], between])


class Planner(Protocol):
    """Finds a path through a map."""

    def plan(
        self, space: PlanningMap, start: SE2, goal: SE2, goes_on: GoesOn = lambda: True
    ) -> Plan | PlanFailure:
        """Return a path between two poses of `world`, or why there is none."""
