"""The drive models: from body velocity to wheels and back (Siegwart et al., chapter 3).

Siegwart, Nourbakhsh, Scaramuzza: Introduction to Autonomous Mobile Robots, 2nd ed., MIT Press 2011.

`Drive` is the list of all kinds; a new one is a file beside the others and a member of it. No code
outside of this package depends on the kind of a drive: they share `wheel_names`, `wheel_radii_m`,
`joint_names`, `joint_max_rad`, `holonomic`, `min_turning_radius_m`, `inverse` and `forward`.

`base` stands between the wheels of a differential drive, at the centre of the rear axle of drives
with a steering, and in the middle of the contacts of the others. All but skid steer assume that no
wheel slips. `inverse` and `forward` are on the control path: plain floats, no checks of their
input. `forward` is linear in the wheel speeds.
"""

from __future__ import annotations

from typing import TypeAlias

from robotctl.model.drives.ackermann import AckermannDrive
from robotctl.model.drives.differential import DifferentialDrive
from robotctl.model.drives.mecanum import MecanumDrive
from robotctl.model.drives.omni import OmniDrive
from robotctl.model.drives.skid_steer import SkidSteerDrive
from robotctl.model.drives.tricycle import TricycleDrive
from robotctl.model.drives.wheels import ActuatorReference

__all__ = [
    "AckermannDrive",
    "ActuatorReference",
    "DifferentialDrive",
    "Drive",
    "MecanumDrive",
    "OmniDrive",
    "SkidSteerDrive",
    "TricycleDrive",
]

Drive: TypeAlias = (
    DifferentialDrive | TricycleDrive | AckermannDrive | SkidSteerDrive | MecanumDrive | OmniDrive
)
"""Any drive model; `kind` identifies them in a robot's file."""
