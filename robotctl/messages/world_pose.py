"""The robot's pose in `world`: the one policy for everything that needs it."""

from __future__ import annotations

from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2


class WorldPose:
    """Transforms the odometry pose into `world`, by the localiser's transform of `odom`.

    - Without a localiser `odom` is `world`: odometry starts where the robot stands.
    - With one, the last `T_world_odom` of status LOCALISED counts. While the localiser searches, or
      is lost, its guesses jump, so odometry continues from the last known place. That is good
      enough to drive by while the localiser tracks the robot, and only knows its place less well.
    - A `T_world_odom` holds for its own `odom_epoch_ns` only. Before the first one, and once the
      odometry has restarted, the pose is unknown until the next message of the localiser.

    Parameters
    ----------
    has_localiser
        Whether to wait for a localiser; one that publishes counts in any case.

    Attributes
    ----------
    latest
        The localiser's last message, of any status.
    """

    def __init__(self, *, has_localiser: bool) -> None:
        self.latest: LocalisationState | None = None
        self._has_localiser = has_localiser
        self._known: LocalisationState | None = None
        """The last message of status LOCALISED."""

    def localise(self, state: LocalisationState) -> None:
        """Take an estimate of the localiser."""
        self._has_localiser = True
        self.latest = state
        if state.status is LocalisationStatus.LOCALISED:
            self._known = state

    def pose(self, control: ControlState) -> SE2 | None:
        """Return `base` in `world`; None if unknown."""
        if not self._has_localiser:
            return control.T_odom_base
        T_world_odom = self.T_world_odom(control)
        return None if T_world_odom is None else T_world_odom @ control.T_odom_base

    def T_world_odom(self, control: ControlState) -> SE2 | None:
        """Return `odom` in `world`; None if unknown."""
        if not self._has_localiser:
            return SE2()
        known = self._known
        if known is None or known.odom_epoch_ns != control.odom_epoch_ns:
            return None
        return known.T_world_odom

    def is_sure(self, control: ControlState) -> bool:
        """Whether the pose is more than odometry since the last known place."""
        if not self._has_localiser:
            return True
        return self._known is self.latest and self.T_world_odom(control) is not None

    def is_tracked(self, control: ControlState) -> bool:
        """Whether the robot may drive by the pose: it is sure, or has only become less so."""
        if self.is_sure(control):
            return True
        tracked = self.latest is not None and self.latest.tracked
        return tracked and self.T_world_odom(control) is not None

    def epoch(self, control: ControlState) -> tuple[int, int]:
        """Return the epochs of `odom` and its pose in `world`; they change when the pose jumps."""
        return control.odom_epoch_ns, 0 if self._known is None else self._known.epoch_ns
