"""The robot's outline, as its configuration tells it."""

from __future__ import annotations

from collections.abc import Sequence

from robotctl.model.footprint import Footprint
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.guard.obstacle_guard import GuardConfig


def body_outline(guard: GuardConfig, mounts: Sequence[SonarMount]) -> Footprint:
    """Return the rectangle that holds the guard's nose and all sonars.

    Behind it reaches to the rearmost sonar, or as far as the nose ahead where none is behind.
    """
    front_m = max([guard.nose_m, *(mount.x_m for mount in mounts)])
    rear_m = min((mount.x_m for mount in mounts), default=-guard.nose_m)
    rear_m = rear_m if rear_m < 0.0 else -guard.nose_m
    half_m = max([guard.half_width_m, *(abs(mount.y_m) for mount in mounts)])
    return Footprint(((front_m, -half_m), (front_m, half_m), (rear_m, half_m), (rear_m, -half_m)))
