"""Assignment of drives' axes to wheels: tables `[[motor]]`, read and changed."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

from robotctl.config.file_edit import Change, Key
from robotctl.config.robot_file import RobotConfig
from robotctl.deploy.setup.bench import Bench
from robotctl.drivers.can.drives.motor_drive import MotorConfig


def axis_of(bench: Bench, wheel: str) -> tuple[int, int]:
    """Return the index of a wheel's drive, and of its axis there."""
    return next(
        (number, place)
        for number, motor in enumerate(bench.config.motors)
        for place, axis in enumerate(motor.axes)
        if axis.actuator == wheel
    )


def with_axis(motor: MotorConfig, place: int, **values: Any) -> MotorConfig:
    """Return a drive with other values of one axis.

    Raises
    ------
    InvalidValue
        If the values are invalid.
    """
    axes = list(motor.axes)
    axes[place] = replace(axes[place], **values)
    changed: MotorConfig = replace(motor, axes=tuple(axes))  # type: ignore[type-var]
    return changed


def changes_of(config: RobotConfig, axes: dict[tuple[int, int], dict[str, Any]]) -> list[Change]:
    """Return the changes that set values of axes, by indices of drive and axis.

    A robot without a table `[[motor]]`, whose wheels our own controller turns in their order, gets
    one.
    """
    if config.motor:
        return [
            Change(_key(number, place, name), value)
            for (number, place), values in axes.items()
            for name, value in values.items()
        ]
    (motor,) = config.motors
    for (_, place), values in axes.items():
        motor = with_axis(motor, place, **values)
    table = {
        "kind": motor.kind,
        "name": motor.name,
        **({"bus": motor.bus} if motor.bus else {}),
        "axes": [
            {name: value for name, value in asdict(axis).items() if name != "ratio"}
            for axis in motor.axes
        ],
    }
    # A robot with tables [[motor]] has the bus of each there.
    moved = [Change(("nodes", motor.name), None)] if motor.bus else []
    return [*moved, Change(("motor",), [table])]


def _key(number: int, place: int, name: str) -> Key:
    return ("motor", number, "axes", place, name)
