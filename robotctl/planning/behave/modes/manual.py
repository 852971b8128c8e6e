"""Mode MANUAL: the operator's sticks steer."""

from __future__ import annotations

from robotctl.control.limiter import LimitsConfig
from robotctl.messages.requests import StickRequest
from robotctl.model.drives.drives import Drive
from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.modes.drive_mode import DriveMode
from robotctl.planning.behave.remote_velocity import stick_velocity


class Manual(DriveMode):
    """Scales the sticks to the speed limits, until they expire.

    Parameters
    ----------
    drive, limits
        Drive model and speed limits.

    Attributes
    ----------
    limits
        The speed limits in force.
    sticks
        The last sticks since the mode began; None: there were none.
    """

    def __init__(self, drive: Drive, limits: LimitsConfig) -> None:
        self._drive = drive
        self.limits = limits
        self.sticks: StickRequest | None = None

    @property
    def expires_ns(self) -> int | None:
        """When the sticks are void [ns]; None: there are none."""
        return None if self.sticks is None else self.sticks.expires_ns

    def begin(self) -> None:
        """Wait for new sticks."""
        self.sticks = None

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002
        """Return the velocity of the sticks."""
        return stick_velocity(self.sticks, self.limits, self._drive, now_ns)
