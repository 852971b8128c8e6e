"""The drive models: from body velocity to wheels and back (notes, sections 1.1 to 1.3).

Wheel 1 is the left wheel of a differential drive and the single motor of a drive-and-steer robot;
wheel 2 is the right wheel, 0 and unused on drive-and-steer. `base` stands between the wheels of a
differential drive and at the centre of the rear axle of the others. All assume that no wheel
slips. `inverse` and `forward` are on the control path: plain floats, no checks of their input.
"""

from __future__ import annotations

from typing import TypeAlias

from robotctl.model.drives.ackermann import AckermannDrive
from robotctl.model.drives.differential import DifferentialDrive
from robotctl.model.drives.tricycle import TricycleDrive
from robotctl.model.drives.wheels import SidePair, WheelReference

__all__ = [
    "AckermannDrive",
    "DifferentialDrive",
    "Drive",
    "SidePair",
    "TricycleDrive",
    "WheelReference",
]

Drive: TypeAlias = DifferentialDrive | TricycleDrive | AckermannDrive
"""Any drive model; `kind` identifies them."""
