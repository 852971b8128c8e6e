"""The control state in `world`, as the localiser corrects it."""

from __future__ import annotations

import msgspec

from robotctl.messages.control import ControlState
from robotctl.messages.estimation import LocalisationState
from robotctl.model.geometry.se2 import SE2


def located(control: ControlState, localisation: LocalisationState | None) -> ControlState:
    """Return `control` with its pose in `world`; without a localiser that is the odometry's.

    The localiser says where the frame of the odometry lies, which changes little from step to
    step, so that a pose keeps the rate and the age of the odometry.
    """
    if localisation is None:
        return control
    T_world_odom = SE2(localisation.x_m, localisation.y_m, localisation.theta_rad)
    pose = T_world_odom @ SE2(control.x_m, control.y_m, control.theta_rad)
    return msgspec.structs.replace(control, x_m=pose.x_m, y_m=pose.y_m, theta_rad=pose.theta_rad)


class Locator:
    """Brings the control states that a process hears into `world`.

    What the localiser said of the odometry of one control process is void for the next one, which
    shows by the distance that it counts from its start.
    """

    def __init__(self) -> None:
        self.localisation: LocalisationState | None = None
        self._distance_m = 0.0

    def localise(self, state: LocalisationState) -> None:
        """Take in what the localiser believes."""
        self.localisation = state

    def locate(self, control: ControlState) -> ControlState:
        """Return a control state with its pose in `world`; they must come in their order."""
        if control.distance_m < self._distance_m:
            self.localisation = None
        self._distance_m = control.distance_m
        return located(control, self.localisation)
