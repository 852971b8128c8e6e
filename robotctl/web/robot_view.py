"""The robot as its clients may see it: the newest states, and what speaks against a request."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from robotctl.config_values import Value
from robotctl.messages.mode import Mode
from robotctl.safety.state_machine import POWERED
from robotctl.web.published import (
    ControlState,
    LocalisationState,
    NavigationState,
    ParameterTable,
    ParameterValues,
    Published,
    RecorderState,
)
from robotctl.web.wire import Response

RESPONSE_STATES: Final = 250
"""Most states of control that a response is made of: those of five seconds."""
SILENT_NS: Final = 500_000_000
"""Age of a state of the robot that says nothing of the present [ns]."""
RECORDER_SILENT_NS: Final = 5_000_000_000
"""The same of the recorder, which waits for the disk [ns]."""


class Now(NamedTuple):
    """The present by the server's monotonic clock, and by the robot's, which may pause [ns]."""

    server_ns: int
    robot_ns: int


@dataclass(slots=True)
class RobotView:
    """Newest states of the robot."""

    control: ControlState | None = None
    navigation: NavigationState | None = None
    localisation: LocalisationState | None = None
    parameters: ParameterTable | None = None
    values: ParameterValues | None = None
    recorder: RecorderState | None = None
    recent: deque[ControlState] = field(default_factory=lambda: deque(maxlen=RESPONSE_STATES))
    """Last states of control."""

    def hear(self, message: Published) -> None:
        """Keep a state."""
        match message:
            case ControlState():
                self.control = message
                self.recent.append(message)
            case NavigationState():
                self.navigation = message
            case LocalisationState():
                self.localisation = message
            case ParameterTable():
                self.parameters = message
            case ParameterValues():
                self.values = message
            case RecorderState():
                self.recorder = message

    def response(self, number: int) -> Response:
        """Return what the wheels did lately."""
        states = tuple(self.recent)
        return Response(
            number,
            tuple(each.stamp_ns for each in states),
            tuple(each.wheel_ref_rad_s for each in states),
            tuple(each.wheel_rad_s for each in states),
        )

    def settable(self) -> dict[str, Value] | None:
        """Return the parameters that may be set, by their keys; None: they are not known yet."""
        if self.parameters is None or self.values is None:
            return None
        pairs = zip(self.parameters.parameters, self.values.wanted, strict=True)
        return {facts.key: value for facts, value in pairs if not facts.is_fixed}

    def objection_to_recording(self, now: Now) -> str:
        """Return why the robot cannot record; empty: it can."""
        recorder = self.recorder
        if recorder is None or now.robot_ns - recorder.stamp_ns > RECORDER_SILENT_NS:
            return "the recorder is silent"
        if not recorder.folder:
            return "this robot has no folder for recordings: start it with --record FOLDER"
        return ""

    def objection_to_motion(self, now: Now) -> str:
        """Return why the robot cannot move now; empty: it can."""
        control = self.control
        if control is None or now.robot_ns - control.stamp_ns > SILENT_NS:
            return "control is silent"
        if control.state not in POWERED:
            return f"{control.reason}: arm first" if control.reason else "arm first"
        return ""

    def why_not(self, mode: Mode) -> str:
        """Return why the robot is not in a mode that was asked for."""
        navigation = self.navigation
        if navigation is None:
            return "navigation does not answer"
        why = f": {navigation.message}" if navigation.message else ""
        return f"{mode.name} was asked for, the robot is in {navigation.mode.name}{why}"
