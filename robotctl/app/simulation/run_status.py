"""State of a simulated run while it goes on, and the settings that all such runs have."""

from __future__ import annotations

from dataclasses import dataclass, field

from robotctl.app.scoring.score import Truth
from robotctl.app.supervision.silence import LONG_NS, STATE_PERIOD_NS, silence
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

TRUTH_PERIOD_NS = 20_000_000
"""How often firmware_sim publishes the truth [ns]."""

BEST_EFFORT = "runtime.allow_best_effort=true"
"""A simulated robot is harmless without real-time rights."""


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
    now_ns: int = 0
    """Present time by the clock of the messages [ns]."""
    control_phase: str = ""
    """Phase of the control process, unless it runs."""
    navigation_period_ns: int = 50_000_000
    page: str = ""
    """Link of the web page; empty: there is none, or not yet."""
    camera_period_ns: int = 200_000_000
    """Twice that of the camera, whose views are stamped by their exposure [ns]."""
    was_ready: bool = False
    """Whether there has been a run that could be scored."""
    ended: str = ""
    """Why the run ended."""
    said_waiting: bool = False
    """Whether it was said that navigation takes its time."""

    @property
    def control_silence(self) -> str:
        """Why `control` says nothing of the present; empty: it does, or was never heard."""
        if self.control is None:
            return ""
        silent = silence("control", self.control.stamp_ns, self.now_ns, STATE_PERIOD_NS)
        return f"control {self.control_phase}" if self.control_phase else silent

    @property
    def navigation_silence(self) -> str:
        """Why `navigation`, and what comes with it, says nothing of the present."""
        state = self.navigation
        if state is None:
            return ""
        return silence("navigation", state.stamp_ns, self.now_ns, self.navigation_period_ns)

    @property
    def camera_silence(self) -> str:
        """Why `view` says nothing of the present."""
        if self.view is None:
            return ""
        return silence("camera", self.view.stamp_ns, self.now_ns, self.camera_period_ns)

    @property
    def truth_silence(self) -> str:
        """Why `truth` says nothing of the present."""
        if self.truth is None:
            return ""
        return silence("firmware_sim", self.truth.stamp_ns, self.now_ns, TRUTH_PERIOD_NS)

    @property
    def is_silent_for_long(self) -> bool:
        """Whether control has ended, or it, navigation or firmware_sim is silent for long."""
        parts = (self.control, self.navigation, self.truth)
        stamps_ns = [part.stamp_ns for part in parts if part is not None]
        since_ns = min(stamps_ns, default=self.now_ns)
        ended = bool(self.control_phase) and self.control is not None
        return ended or self.now_ns - since_ns > LONG_NS

    @property
    def silences(self) -> tuple[str, ...]:
        """All that says nothing of the present."""
        every = (
            self.control_silence,
            self.navigation_silence,
            self.camera_silence,
            self.truth_silence,
        )
        return tuple(each for each in every if each)

    def picture(self, message: ParticleCloud | PlanView) -> None:
        """Keep what is for people to look at."""
        if isinstance(message, PlanView):
            self.plan = message
        else:
            self.cloud = message
