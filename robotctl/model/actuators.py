"""Actuators: the driven wheels and the joints of a robot, and the abilities of their drives.

A robot's actuators have one order everywhere: its wheels in the order of `Drive.wheel_names`, then
its joints in the order of `Drive.joint_names`. Quantities of an actuator are those of wheel or
joint in its positive direction; the driver handles gear ratio and sense of the motor.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Takes(enum.Enum):
    """Kind of command that a drive takes for an actuator."""

    DUTY = "duty"
    """Share of the supply in [-1, 1]; our wheel loop closes the speed."""
    SPEED = "speed"
    """Speed [rad/s]; the drive closes its own loop."""
    ANGLE = "angle"
    """Angle of a joint [rad]."""


@dataclass(frozen=True, slots=True)
class Abilities:
    """Abilities of one kind of motor drive: part of its entry in `DRIVES`.

    Parameters
    ----------
    takes
        Kind of command for a wheel.
    stops_alone
        Whether it has a time-out of its own that stops it when the host is silent.
    brakes
        Whether a wheel without power is braked; else it coasts.
    protected
        Whether command and feedback carry a counter and a checksum of ours.
    stamps_positions
        Whether it stamps a measured position by its own clock.
    tells_speed, tells_current, tells_temperature, tells_voltage
        Whether it reports these.
    """

    takes: Takes
    stops_alone: bool
    brakes: bool
    protected: bool = False
    stamps_positions: bool = False
    tells_speed: bool = True
    tells_current: bool = True
    tells_temperature: bool = True
    tells_voltage: bool = True


@dataclass(frozen=True, slots=True)
class Actuator:
    """One wheel or joint.

    Parameters
    ----------
    name
        Name of the wheel or joint.
    drive
        Name of the drive that turns it, the `part` of its faults.
    takes
        Kind of command for it.
    ticks_per_revolution
        Unit of its position: ticks for one turn, > 0; 0 for a joint.
    abilities
        Abilities of its drive.
    """

    name: str
    drive: str
    takes: Takes
    ticks_per_revolution: int
    abilities: Abilities
