"""The control state in `world`, as the localiser corrects it."""

from __future__ import annotations

import msgspec

from robotctl.model.se2 import SE2
from robotctl.runtime.messages import ControlState, LocalisationState


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
