"""Mode HOLD: the robot stands."""

from __future__ import annotations

from robotctl.planning.behave.behaviours.behaviour import BehaviourInput, BehaviourOutput
from robotctl.planning.behave.modes.drive_mode import DriveMode


class Hold(DriveMode):
    """Stands still.

    Attributes
    ----------
    reason
        Why the robot itself went to HOLD; empty: it was told to.
    """

    def __init__(self) -> None:
        self.reason = ""

    def begin(self) -> None:
        """Stand because the robot was told to."""
        self.reason = ""

    def step(self, situation: BehaviourInput, now_ns: int) -> BehaviourOutput:  # noqa: ARG002
        """Return rest."""
        return BehaviourOutput(0.0, 0.0, text=self.reason)
