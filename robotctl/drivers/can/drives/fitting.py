"""Which drive turns which wheel: the tables `[[motor]]` against the robot's wheels and joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

from robotctl import toml_source
from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.motor_drive import MotorConfig
from robotctl.model.actuators import Actuator, Takes
from robotctl.model.drives.drives import Drive

Problem: TypeAlias = tuple[toml_source.Key, str]
"""A key at fault, and the reason."""


class Fitted(NamedTuple):
    """A drive of a robot.

    Attributes
    ----------
    motor
        Its table.
    axes
        Its axes, as the table has them.
    places
        Places of what hangs on them among the robot's actuators.
    """

    motor: MotorConfig
    axes: tuple[Axis, ...]
    places: tuple[int, ...]


def fit(drive: Drive, motors: Sequence[MotorConfig]) -> tuple[Fitted, ...]:
    """Return the drives of a robot without `problems`."""
    names = (*drive.wheel_names, *drive.joint_names)
    return tuple(
        Fitted(
            motor,
            tuple(
                Axis(axis, Takes.ANGLE, 0)
                if axis.actuator in drive.joint_names
                else Axis(axis, motor.abilities.takes, drive.counts_per_revolution)
                for axis in motor.axes
            ),
            tuple(names.index(axis.actuator) for axis in motor.axes),
        )
        for motor in motors
    )


def actuators_of(drives: Sequence[Fitted]) -> tuple[Actuator, ...]:
    """Return the wheels and joints of a robot, in their order."""
    actuators = {
        place: Actuator(
            axis.name, motor.name, axis.takes, axis.ticks_per_revolution, motor.abilities
        )
        for motor, axes, places in drives
        for axis, place in zip(axes, places, strict=True)
    }
    return tuple(actuators[place] for place in sorted(actuators))


def problems(drive: Drive, motors: Sequence[MotorConfig]) -> Iterator[Problem]:
    """Yield wheels without a drive or with two, unknown ones, and names and numbers used twice."""
    names = (*drive.wheel_names, *drive.joint_names)
    for number, motor in enumerate(motors):
        yield from _doubled(number, motors)
        if not motor.axes:
            yield ("motor", number, "axes"), "must name the wheel or joint on each axis, found none"
    yield from _misfits(motors, names)


def _doubled(number: int, motors: Sequence[MotorConfig]) -> Iterator[Problem]:
    """Yield a name or number that a drive before has."""
    motor, before = motors[number], motors[:number]
    if motor.name in [each.name for each in before]:
        yield ("motor", number, "name"), f"must differ from those before, found {motor.name!r}"
    for each in before:
        same = set(each.node_ids) & set(motor.node_ids)
        if same and (each.kind, each.bus) == (motor.kind, motor.bus):
            ids = ", ".join(map(str, sorted(same)))
            text = f"{ids} found, which {each.name} has on the same bus"
            yield ("motor", number, "node_id"), text


def _misfits(motors: Sequence[MotorConfig], names: Sequence[str]) -> Iterator[Problem]:
    """Yield what is unknown, turned by two axes, or by none."""
    seen: set[str] = set()
    for number, motor in enumerate(motors):
        for place, axis in enumerate(motor.axes):
            key = ("motor", number, "axes", place, "actuator")
            if axis.actuator not in names:
                hint = toml_source.nearest(axis.actuator, names)
                yield key, f"no wheel or joint {axis.actuator!r} on this robot{hint}"
            elif axis.actuator in seen:
                yield key, f"{axis.actuator!r} found, which another axis turns already"
            seen.add(axis.actuator)
    for name in names:
        if name not in seen:
            yield ("motor",), f"no axis turns {name!r}; this robot has {', '.join(names)}"
