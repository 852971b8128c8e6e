"""The robot as the page's server reaches it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from robotctl.config_values import Value
from robotctl.messages.control import ControlRequest, NavigationRequest
from robotctl.messages.recording import SetRecording
from robotctl.messages.tuning import ParameterRequest
from robotctl.web.plan_uploads import PlanStore
from robotctl.web.robot_view import Now
from robotctl.web.wire import CameraPicture, ComputerState, RobotOutline


class PictureSource(Protocol):
    """The robot's camera, for who looks on."""

    def picture(self, view: bytes | None) -> CameraPicture | None:
        """Return the newest picture with the camera's newest published view; None: no new one.

        It takes some milliseconds, and is called by threads, one at a time.
        """

    def close(self) -> None:
        """Receive no more pictures until the next is asked for."""


@dataclass(slots=True)
class RobotSide:
    """The robot as the server reaches it.

    Parameters
    ----------
    outline
        What does not change.
    now
        The present by both clocks.
    to_control, to_navigation, to_telemetry, to_recorder
        Hand on a request; whether a process was there to take it.
    say
        Tell logs and ground stations.
    stores
        Keep plans over restarts, by their kind.
    camera
        Pictures of the camera; None: there is none.
    computer
        Figures of the computer, asked for in a thread, since a disk may hang; None: there are none.
    save
        Write parameters, by their keys, into the robot's file, in any thread; return the names of
        the file and of a copy of the old one, and the keys that are new. Raises `RobotctlError` or
        `OSError` where that cannot be.
    """

    outline: RobotOutline
    now: Callable[[], Now]
    to_control: Callable[[ControlRequest], bool]
    to_navigation: Callable[[NavigationRequest], bool]
    say: Callable[[str], None]
    to_telemetry: Callable[[ParameterRequest], bool]
    to_recorder: Callable[[SetRecording], bool]
    save: Callable[[Mapping[str, Value]], tuple[str, str, tuple[str, ...]]]
    stores: Mapping[str, PlanStore] = field(default_factory=dict)
    camera: PictureSource | None = None
    computer: Callable[[], ComputerState] | None = None
