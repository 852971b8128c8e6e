"""The last check of an actuator command, after every other layer and just before the wire.

It expects to find nothing: every layer before it keeps its own limits. Anything it finds is a
defect, so it does not repair single values but refuses the whole command. One wheel turning while
the other is zeroed would spin the robot.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from robotctl.messages.faults import Fault, FaultCode
from robotctl.model.actuators import Actuator, Takes

TOLERANCE: Final = 1e-6
"""A value beyond its bound by no more than this is rounding, and is clamped [duty, rad/s, rad]."""

_UNITS: Final = {Takes.DUTY: "duty", Takes.SPEED: "rad/s", Takes.ANGLE: "rad"}


class Bound(NamedTuple):
    """Greatest command of an actuator, in both directions."""

    name: str
    most: float
    unit: str


def bounds(
    actuators: tuple[Actuator, ...], speed_max_rad_s: float, joint_max_rad: tuple[float, ...]
) -> tuple[Bound, ...]:
    """Return the bounds of a robot's actuators.

    Parameters
    ----------
    actuators
        In the robot's order.
    speed_max_rad_s
        Speed of the fastest wheel at the robot's limits [rad/s].
    joint_max_rad
        Bound of each joint [rad].
    """
    wheels = {Takes.DUTY: 1.0, Takes.SPEED: speed_max_rad_s}
    angles = iter(joint_max_rad)
    return tuple(
        Bound(
            each.name,
            next(angles) if each.takes is Takes.ANGLE else wheels[each.takes],
            _UNITS[each.takes],
        )
        for each in actuators
    )


def clamp(value: float, bound: float) -> float:
    """Return `value` limited to [-bound, bound]; bound >= 0. A nan stays one."""
    if value > bound:
        return bound
    if value < -bound:
        return -bound
    return value


def guarded(values: tuple[float, ...], limits: tuple[Bound, ...]) -> tuple[float, ...] | Fault:
    """Return the values that may be sent; a fault if one is not finite or beyond its bound."""
    if len(values) != len(limits):
        text = f"command guard: {len(values)} values for {len(limits)} actuators"
        return Fault(FaultCode.COMMAND_GUARD, text)
    for value, (_, most, _) in zip(values, limits, strict=True):
        if not abs(value) <= most:
            return _corrected(values, limits)
    return values


def _corrected(values: tuple[float, ...], limits: tuple[Bound, ...]) -> tuple[float, ...] | Fault:
    """Return values with what is rounding clamped; a fault if one is more than that."""
    allowed = []
    for value, limit in zip(values, limits, strict=True):
        most = limit.most
        if not abs(value) <= most + TOLERANCE:  # false for nan as well
            text = (
                f"command guard: {limit.name} {value} {limit.unit}: {most:g} to either side allowed"
            )
            return Fault(FaultCode.COMMAND_GUARD, text, limit.name)
        allowed.append(clamp(value, most))
    return tuple(allowed)
