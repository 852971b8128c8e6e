"""Actuators: the driven wheels and the joints of a robot, and what the drives behind them can do.

A robot's actuators have one order everywhere: its wheels, as `Drive.wheel_names` has them, then its
joints, as `Drive.joint_names` has them. Quantities of an actuator are those of wheel or joint in
its positive direction: gear ratio and sense of a motor are the driver's business.
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
        What it takes for a wheel.
    stops_alone
        Whether it has a time-out of its own, by which it stops when the host is silent.
    brakes
        Whether a wheel without power is braked; else it coasts.
    protected
        Whether command and feedback carry a counter and a checksum of ours.
    stamps_positions
        Whether it tells when it measured a position, by its own clock.
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
        What a command for it is.
    ticks_per_revolution
        Unit of its position: ticks for one turn, > 0; 0 for a joint.
    abilities
        What its drive can do.
    """

    name: str
    drive: str
    takes: Takes
    ticks_per_revolution: int
    abilities: Abilities
