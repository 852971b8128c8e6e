"""Target velocities of all axes of a drive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robotctl.drivers.can.drives.axis import Axis
from robotctl.drivers.can.drives.cia402.device import VELOCITY, Device
from robotctl.drivers.can.drives.cia402.dialects import I32_MAX

_I16_MAX: Final = 0x7FFF
_ZEROS: Final = (0.0,) * 8


class Targets:
    """Turns speeds of wheels into the velocities that the drive's process data carry.

    Parameters
    ----------
    axes, places
        Axes with a wheel, and their places in the process data.
    device
        What the drive takes.
    units_per_rad
        Target velocity for 1 rad/s of the motor.

    Attributes
    ----------
    none
        Targets of a drive that gives no power.
    """

    __slots__ = ("_axes", "_max", "_units_per_rad", "_values", "_wire_max", "none")

    def __init__(
        self, axes: Sequence[Axis], places: Sequence[int], device: Device, units_per_rad: float
    ) -> None:
        dialect = device.dialect
        self._axes = tuple(zip(places, axes, strict=True))
        self._units_per_rad = units_per_rad
        # A layout of a maker carries all axes that the drive has, wheels on them or not.
        self._values = [0] * (max(places) + 1 if dialect.layout is None else dialect.axes)
        self.none = tuple(self._values)
        is_short = device.mode == VELOCITY or dialect.layout is not None
        self._wire_max = _I16_MAX if is_short else I32_MAX
        self._max = min(dialect.target_max, self._wire_max)

    def of(self, speeds_rad_s: Sequence[float]) -> Sequence[int] | None:
        """Return the targets for speeds of the wheels [rad/s], held within what the drive takes.

        None where the wire cannot carry one; without speeds the wheels are to stand.
        """
        top, wire_top, values = self._max, self._wire_max, self._values
        for (place, axis), speed in zip(self._axes, speeds_rad_s or _ZEROS, strict=False):
            units = axis.to_motor(speed) * self._units_per_rad
            if not -wire_top <= units <= wire_top:  # nan, too
                return None
            values[place] = round(min(max(units, -top), top))
        return values
