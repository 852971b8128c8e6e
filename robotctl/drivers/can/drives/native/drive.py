"""Abilities of our motor controller, and the actuators on it."""

from __future__ import annotations

from typing import Final

from robotctl.model.actuators import Abilities, Actuator, Takes
from robotctl.model.drives.drives import Drive

NAME: Final = "drive"

ABILITIES: Final = Abilities(
    takes=Takes.DUTY,
    stops_alone=True,
    brakes=True,
    protected=True,
    stamps_positions=True,
    tells_speed=False,
)


def actuators_on(drive: Drive) -> tuple[Actuator, ...]:
    """Return the wheels and joints of a robot that one of our controllers drives."""
    return (
        *(
            Actuator(name, NAME, Takes.DUTY, drive.counts_per_revolution, ABILITIES)
            for name in drive.wheel_names
        ),
        *(Actuator(name, NAME, Takes.ANGLE, 0, ABILITIES) for name in drive.joint_names),
    )
