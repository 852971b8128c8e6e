"""Settings of the local controllers in a robot's file; without numpy, for all that read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from robotctl.config_values import check_ranges

FEWEST: Final = 50
"""Fewest samples with which a controller finds its way."""


@dataclass(frozen=True, slots=True)
class FollowConfig:
    """How a planned path is followed round what stands in the way, see `Follower`.

    Parameters
    ----------
    tau_s
        Horizon over which velocities are judged [s], 0.05 to 10.
    samples
        Candidates of a step, 50 to 100 000.
    reaction_s
        Maximum time from a command to its effect [s], 0 to 2.
    comfort_m
        Clearance below which a velocity costs more [m], 0.01 to 5.
    goal, path, clearance, heading, smoothness
        Weights of the distance left, of the distance from the path, of nearness to obstacles, of
        looking elsewhere, of changes, 0 to 1000.
    blocked, people
        Weights of a motion that ends at an obstacle, and of nearness to what moves, 0 to 1000.
    lateral_m
        Distance from the path that costs 1 [m], 0.01 to 10.
    people_m
        Clearance from what moves below which a velocity costs more [m], 0.01 to 10.
    let_pass_s
        Time ahead for which a moving thing claims the places that it is going to [s], 0 to 10.
    later_s
        Time beyond the horizon in which the robot should not be in anybody's way [s], 0 to 20.
    look_m
        Distance along the path to the point that the robot is to look at [m], 0.05 to 5.
    creep_m_s
        Maximum speed that needs no margin [m/s], 0.01 to 1.
    waiting_steps
        Steps for which nothing leads on before the robot backs off, or counts as blocked, 1 to
        1000.
    back_m
        Distance that it then backs off [m], 0 to 5.
    backs
        Times that it backs off on one path, 0 to 100.
    spread
        Standard deviation of the velocities that `mppi` tries, as a share of the maximum, 0.01
        to 1: larger, it finds ways round more, and drives less evenly.
    temperature
        Difference in cost by which `mppi` weighs a sample e times less, 0.001 to 10.
    window_s
        Time within which the velocities that `dwa` tries can be reached [s], 0.05 to 5.
    position_tolerance_m, heading_tolerance_rad
        Errors within which the goal is reached [m], 0.001 to 1, [rad], 0.001 to 3.
    near_m, near_steered_m
        Distance from the goal at which a robot that turns on the spot arrives, and one that steers
        [m], 0.05 to 5.
    beside_m
        Maximum distance beside the path at which one that steers is led along its end [m], 0.01 to
        2.
    gain_per_m
        Feedback of one that steers, in which errors fade by e per 1 / gain [1/m], 0.5 to 20.
    turn_first_rad
        Bearing of the goal beyond which a robot turns to it on the spot [rad], 0.05 to 3.
    arrival_m_s, turn_min_rad_s
        Minimum speed [m/s], 0.01 to 0.5, and turning rate [rad/s], 0.01 to 1, of an arrival.
    inside_share, leaves_share
        Shares of the tolerances within which the robot stops, 0.05 to 1, and beyond which it begins
        again, 1 to 10.
    seed
        Seed of the random samples.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    tau_s: float = 1.5
    samples: int = 500
    reaction_s: float = 0.1
    comfort_m: float = 0.25
    goal: float = 1.0
    path: float = 0.3
    clearance: float = 0.5
    heading: float = 0.5
    smoothness: float = 0.15
    blocked: float = 3.0
    people: float = 2.0
    lateral_m: float = 0.5
    people_m: float = 0.5
    let_pass_s: float = 0.8
    later_s: float = 2.0
    look_m: float = 0.5
    creep_m_s: float = 0.25
    waiting_steps: int = 10
    back_m: float = 0.3
    backs: int = 3
    spread: float = 0.25
    temperature: float = 0.05
    window_s: float = 0.5
    position_tolerance_m: float = 0.05
    heading_tolerance_rad: float = 0.08
    near_m: float = 0.35
    near_steered_m: float = 1.0
    beside_m: float = 0.15
    gain_per_m: float = 5.0
    turn_first_rad: float = 0.6
    arrival_m_s: float = 0.05
    turn_min_rad_s: float = 0.15
    inside_share: float = 0.6
    leaves_share: float = 1.5
    seed: int = 0

    def __post_init__(self) -> None:
        weight, share = (0.0, 1000.0), (0.01, 1.0)
        check_ranges(
            self,
            tau_s=(0.05, 10.0),
            samples=(FEWEST, 100_000),
            reaction_s=(0.0, 2.0),
            comfort_m=(0.01, 5.0),
            goal=weight,
            path=weight,
            clearance=weight,
            heading=weight,
            smoothness=weight,
            blocked=weight,
            people=weight,
            lateral_m=(0.01, 10.0),
            people_m=(0.01, 10.0),
            let_pass_s=(0.0, 10.0),
            later_s=(0.0, 20.0),
            look_m=(0.05, 5.0),
            creep_m_s=(0.01, 1.0),
            waiting_steps=(1, 1000),
            back_m=(0.0, 5.0),
            backs=(0, 100),
            spread=share,
            temperature=(0.001, 10.0),
            window_s=(0.05, 5.0),
            position_tolerance_m=(0.001, 1.0),
            heading_tolerance_rad=(0.001, 3.0),
            near_m=(0.05, 5.0),
            near_steered_m=(0.05, 5.0),
            beside_m=(0.01, 2.0),
            gain_per_m=(0.5, 20.0),
            turn_first_rad=(0.05, 3.0),
            arrival_m_s=(0.01, 0.5),
            turn_min_rad_s=share,
            inside_share=(0.05, 1.0),
            leaves_share=(1.0, 10.0),
            seed=(0, 2**31 - 1),
        )
