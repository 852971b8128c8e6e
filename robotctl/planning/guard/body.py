"""The robot's outline, as its configuration tells it."""

from __future__ import annotations

from collections.abc import Sequence

from robotctl.model.footprint import Footprint
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.config import GuardConfig
from robotctl.planning.guard.obstacle_guard import body_rectangle


def body_outline(guard: GuardConfig, mounts: Sequence[SonarMount]) -> Footprint:
    """Return the rectangle of the guard, see `body_rectangle`."""
    rear_m, front_m, half_m = body_rectangle(guard, mounts)
    return Footprint(((front_m, -half_m), (front_m, half_m), (rear_m, half_m), (rear_m, -half_m)))
