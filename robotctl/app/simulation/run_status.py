"""What is known of a simulated run while it goes on, and the settings that all such runs have."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec

from robotctl.messages.control import ControlState, NavigationState
from robotctl.messages.estimation import (
    CameraView,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
)
from robotctl.model.geometry.se2 import SE2

PATIENCE = "safety.feedback_timeout_periods=10"
"""A simulated drive is a process of an ordinary computer, whose pauses are no fault of a robot."""

BEST_EFFORT = "runtime.allow_best_effort=true"
"""A simulated robot is harmless without real-time rights."""


class Truth(msgspec.Struct, frozen=True):
    """The part of firmware_sim's published truth that scores a run."""

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float
    distance_m: float
    collisions: int
    power_off_ns: int
    unsafe_motions: int
    unsafe_reason: str
    late_max_ns: int
    ran_into: int
    people: tuple[tuple[float, float], ...]


@dataclass(slots=True)
class RunStatus:
    """State of a run in progress."""

    elapsed_s: float = 0.0
    control: ControlState | None = None
    navigation: NavigationState | None = None
    truth: Truth | None = None
    localisation: LocalisationState | None = None
    cloud: ParticleCloud | None = None
    map: LiveMap | None = None
    view: CameraView | None = None
    plan: PlanView | None = None
    pose: SE2 | None = None
    """`base` in `world`; None if that is unknown."""
    lines: list[str] = field(default_factory=list)
    real_time_factor: float = 1.0

    def picture(self, message: ParticleCloud | PlanView) -> None:
        """Keep what is for people to look at."""
        if isinstance(message, PlanView):
            self.plan = message
        else:
            self.cloud = message
