"""Permission to drive, and to drive autonomously."""

from __future__ import annotations

from typing import Final

from robotctl.messages.mode import Mode
from robotctl.planning.behave.modes.drive_mode import BY_HAND
from robotctl.planning.behave.stalls import SILENT, Stall, StallWatch
from robotctl.planning.navigation_step import NavigationInputs

_STOPPED: Final = "the robot was stopped"


class DriveSupervision:
    """Watches over an autonomous robot: operator, stops, stalls, and the camera's view.

    By hand, in HOLD and MANUAL, the operator sees for himself: there only arming counts.

    Attributes
    ----------
    areas
        Names of the areas that the robot was in when it last knew its place.
    """

    def __init__(self) -> None:
        self._attended = True
        self._enabled = False
        """As of the last step with a control state."""
        self._stopped_ns = -1
        """When a stop of the robot was last received [ns]."""
        self._stalls = StallWatch()
        self._stall: Stall | None = None
        """The stall of an enabled robot that is not over."""
        self._waits_to_see = False
        self.areas: tuple[str, ...] = ()
        self._notices: list[str] = []

    def update(self, inputs: NavigationInputs, mode: Mode, now_ns: int) -> str:
        """Take the inputs of a step; return why the robot must go to HOLD, empty if it need not."""
        stopped = self._enabled and inputs.control_is_fresh and not inputs.enabled
        self._attended = inputs.attended
        if inputs.control_is_fresh:
            self._enabled = inputs.enabled
        if stopped:
            self._stopped_ns = now_ns
        stall = self._stalls.step(now_ns, inputs.late_ns, control_is_fresh=inputs.control_is_fresh)
        self._stall = stall if self._enabled else None
        if mode in BY_HAND:
            return ""
        if self._enabled and self._stalls.over:
            self._notices.append(self._stalls.over)
        return self._reason_to_hold(inputs, stopped=stopped)

    def _reason_to_hold(self, inputs: NavigationInputs, *, stopped: bool) -> str:
        """Return why the robot must not go on without an operator, empty if it may."""
        if not self._attended:
            return "no ground station is connected"
        if inputs.station_lost:
            return "the ground station is lost"
        if stopped:
            return _STOPPED
        if self._stall is not None and self._stall.ends_mode:
            self._stalls.forget()
            return self._stall.words
        return ""

    def refusal(self, mode: Mode) -> str:
        """Return why a mode is refused now; empty if it is not."""
        if not self._attended and mode not in BY_HAND:
            return "no ground station is connected"
        return ""

    def outdated(self, mode: Mode, asked_ns: int) -> str:
        """Return why a mode that was asked for then [ns] is not wanted any more, empty if it is."""
        return _STOPPED if asked_ns <= self._stopped_ns and mode not in BY_HAND else ""

    def reason_to_stand(self, inputs: NavigationInputs, mode: Mode) -> str:
        """Return why the robot must not move in this step, empty if it may."""
        self._note_blindness(inputs.blind, mode)
        if mode not in BY_HAND:
            if self._stall is not None:
                return f"waits: {self._stall.words}"
            if inputs.enabled and inputs.blind:
                return f"waits: {inputs.blind}"
        if inputs.enabled:
            return ""
        return "not armed" if inputs.control_is_fresh else SILENT

    def _note_blindness(self, blind: str, mode: Mode) -> None:
        """Report a robot in a mode of its own that stands because it sees no floor."""
        waits = bool(blind) and self._enabled and mode not in BY_HAND
        if waits and not self._waits_to_see:
            self._notices.append(f"{blind}: the robot waits")
        elif self._waits_to_see and not blind:
            self._notices.append("the camera gives pictures again")
        self._waits_to_see = waits

    def note_areas(self, areas: tuple[str, ...]) -> None:
        """Report areas that the robot has come into, or has left."""
        if areas == self.areas:
            return
        self._notices += [f"in {name}" for name in areas if name not in self.areas]
        self._notices += [f"out of {name}" for name in self.areas if name not in areas]
        self.areas = areas

    def take_notices(self) -> list[str]:
        """Return sentences for people since the last call."""
        notices, self._notices = self._notices, []
        return notices
