"""Slow down and stop ahead of what sonars and camera see in the direction of travel."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, NamedTuple, TypeAlias

from robotctl.model.angles import wrap_angle
from robotctl.model.sonar import SonarMount

Point: TypeAlias = tuple[float, float]
"""x, y of `base` [m]."""

MOST_BLOCKED_S: Final = 1e6


@dataclass(frozen=True, slots=True)
class GuardConfig:
    """When the guard brakes.

    Parameters
    ----------
    margin_m
        Gap kept between a sonar and an obstacle ahead of it [m], > 0.
    deceleration_m_s2
        Braking that the robot manages for sure [m/s^2], > 0.
    reaction_s
        Time from an echo to the brakes, with the median filter and the ring's refresh [s], > 0.
    nose_m
        How far the robot reaches from `base` in the direction of travel [m], > 0: from there the
        gap to what the camera sees is counted.
    half_width_m
        Half of the robot's width with a little room [m], > 0: slanting sonars count only what is
        in its way.
    cone_deg
        Sonars within this angle of the direction of travel look ahead [deg], > 0. Others, up to
        80 degrees, are slanting.
    blocked_max_s
        A robot blocked for this long gives up [s], > 0, at most 1e6.

    Raises
    ------
    ValueError
        If a value is out of its range.
    """

    margin_m: float = 0.12
    deceleration_m_s2: float = 0.8
    reaction_s: float = 0.2
    nose_m: float = 0.2
    half_width_m: float = 0.18
    cone_deg: float = 30.0
    blocked_max_s: float = 10.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{field.name}: {value} found, a finite number > 0 allowed")
        if self.blocked_max_s > MOST_BLOCKED_S:
            raise ValueError(
                f"blocked_max_s: {self.blocked_max_s} found, at most {MOST_BLOCKED_S:.0f} allowed"
            )


class GuardStep(NamedTuple):
    """What the guard allows."""

    v_max_m_s: float
    """Fastest speed in the direction asked for [m/s], >= 0; inf where nothing is near."""
    obstacle: str
    """What limits it, for people; empty where nothing does."""


class _View(NamedTuple):
    """One sonar as seen along the direction of travel."""

    slot: int
    name: str
    straight: bool
    lateral_m: float
    sine: float
    cosine: float


class ObstacleGuard:
    """Limits the speed so that braking ends `margin_m` before the obstacle.

    An obstacle is taken to lie on the sonar's axis. Sonars that look ahead limit the speed for
    straight motion and bends alike, since the wall they see may reach into the bend. The median of
    the last three readings of each sonar keeps single outliers and lost echoes out. A sonar ahead
    without reading (nan) makes the robot stand: it would drive blind. Without a sonar in the
    direction of travel there is nothing to guard, and the speed is free. Turning on the spot is
    free, too. Points on the floor, which a camera sees, count where the robot driving straight on
    would meet them.

    Parameters
    ----------
    config
        See there.
    mounts
        The sonars, in the order of the ranges.
    """

    def __init__(self, config: GuardConfig, mounts: Sequence[SonarMount]) -> None:
        self._config = config
        self._ahead = {sign: _views(mounts, sign, config) for sign in (1, -1)}
        self._history: list[list[float]] = []
        self._count = len(mounts)
        self.reset()

    def reset(self) -> None:
        """Forget past readings."""
        self._history = [[] for _ in range(self._count)]
        self._floor: Sequence[Point] = ()

    def observe(
        self, ranges_m: Sequence[float], new: Sequence[bool], floor_base: Sequence[Point] = ()
    ) -> None:
        """Take what was heard and seen; once a step.

        Parameters
        ----------
        ranges_m
            The last reading of each sonar [m].
        new
            Whether it has come since the last step: each counts once, but a missing one (nan)
            with each step, since nothing new may come any more.
        floor_base
            Points of the floor in `base` [m].
        """
        self._floor = floor_base
        for past, reading, is_new in zip(self._history, ranges_m, new, strict=True):
            if is_new or math.isnan(reading):
                past.append(reading)
                if len(past) > 3:
                    del past[0]

    def step(self, direction: float) -> GuardStep:
        """Return the limit for driving forwards (`direction` > 0) or backwards (< 0)."""
        if direction == 0.0:
            return GuardStep(math.inf, "")
        gap, obstacle = math.inf, ""
        for view in self._ahead[1 if direction > 0.0 else -1]:
            reading = _median(self._history[view.slot])
            if view.straight and math.isnan(reading):
                return GuardStep(0.0, f"sonar {view.name} gives no reading")
            free = self._free_way(view, reading)
            if free < gap:
                gap, obstacle = free, f"{view.name} sees {reading:.2f} m"
        on_floor = self._free_floor(math.copysign(1.0, direction))
        if on_floor < gap:
            gap, obstacle = on_floor, f"something lies on the floor {on_floor:.2f} m away"
        v_max = self._speed_for(gap - self._config.margin_m)
        return GuardStep(v_max, obstacle)

    def _free_way(self, view: _View, reading: float) -> float:
        """Return the way along the direction of travel up to what a sonar sees [m]."""
        if view.straight:
            return reading
        # nan compares false: a slanting sonar that is missing limits nothing
        if abs(view.lateral_m + reading * view.sine) < self._config.half_width_m:
            return reading * view.cosine
        return math.inf

    def _free_floor(self, sign: float) -> float:
        """Return the way from the robot's nose up to the nearest point on the floor [m]."""
        half_m = self._config.half_width_m
        met = (sign * x_m for x_m, y_m in self._floor if sign * x_m > 0.0 and abs(y_m) < half_m)
        return min(met, default=math.inf) - self._config.nose_m

    def _speed_for(self, way_m: float) -> float:
        """Return the speed v with v reaction + v^2 / (2 a) = way [m/s]."""
        if way_m <= 0.0:
            return 0.0
        delay = self._config.deceleration_m_s2 * self._config.reaction_s
        return math.sqrt(delay * delay + 2.0 * self._config.deceleration_m_s2 * way_m) - delay


def _views(mounts: Sequence[SonarMount], sign: int, config: GuardConfig) -> list[_View]:
    """Return the sonars that look in the direction of travel (`sign` 1 or -1)."""
    views = []
    for index, mount in enumerate(mounts):
        heading = wrap_angle(mount.heading_rad if sign > 0 else mount.heading_rad - math.pi)
        straight = abs(heading) <= math.radians(config.cone_deg)
        if straight or abs(heading) <= math.radians(80.0):
            lateral = sign * mount.y_m
            views.append(
                _View(index, mount.name, straight, lateral, math.sin(heading), math.cos(heading))
            )
    return views


def _median(readings: list[float]) -> float:
    """Return the median of at most three readings; nan where most are nan or there is none."""
    valid = sorted([reading for reading in readings if not math.isnan(reading)])
    if 2 * len(valid) <= len(readings):
        return math.nan
    return valid[(len(valid) - 1) // 2]
