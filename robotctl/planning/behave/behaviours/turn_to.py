"""The behaviour that turns on the spot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from robotctl.model.geometry.angles import wrap_angle
from robotctl.planning.behave.behaviours.behaviour import (
    Behaviour,
    BehaviourInput,
    BehaviourOutput,
    done,
)
from robotctl.planning.behave.behaviours.item import NO_LENGTH_S, require_bounded, require_positive
from robotctl.planning.behave.behaviours.kind import Abilities, Kind, NavigatedRobot
from robotctl.planning.config import PursuitConfig
from robotctl.planning.path.local.pursuit import turn_rate


@dataclass(frozen=True, slots=True)
class TurnToItem:
    """Turn on the spot to a heading. Not for drive-and-steer robots.

    Parameters
    ----------
    kind
        Always "turn_to".
    heading_deg
        Heading in `world`, 0 along x, 90 along y [deg].
    name
        Name shown to people.
    time_out_s
        The item fails after this time [s], > 0.
    """

    kind: Literal["turn_to"]
    heading_deg: float
    name: str = ""
    time_out_s: float | None = 20.0

    def __post_init__(self) -> None:
        require_bounded(self, "heading_deg")
        require_positive(self, "time_out_s")


class TurnTo(Behaviour):
    """Turns on the spot to a heading of `world` [rad]. Only for a differential drive."""

    tolerance_rad = math.radians(2.0)

    def __init__(self, heading_rad: float, config: PursuitConfig) -> None:
        self._heading = heading_rad
        self._config = config

    def reset(self) -> None:
        """Start over; there is no state."""

    def pause(self) -> None:
        """There is nothing to forget."""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002 - as all behaviours
        """Return the next turn rate; done within 2 degrees and nearly at rest."""
        error = wrap_angle(self._heading - situation.pose.theta_rad)
        slow = abs(situation.twist.omega_rad_s) < 0.1
        if abs(error) <= self.tolerance_rad and slow:
            return done()
        return BehaviourOutput(
            0.0, turn_rate(error, self._config), text=f"{math.degrees(error):.0f} deg to turn"
        )


def _make(item: TurnToItem, robot: NavigatedRobot) -> TurnTo:
    return TurnTo(math.radians(item.heading_deg), robot.config.pursuit)


def _time_out_s(item: TurnToItem) -> float:
    return item.time_out_s or NO_LENGTH_S


def _problems(_item: TurnToItem, robot: Abilities) -> Iterator[str]:
    if robot.drive.steered:
        kind = robot.drive.kind
        yield f"a robot with {kind} drive cannot turn on the spot; use drive with an arc"


TURN_TO = Kind(_make, _time_out_s, _problems)
