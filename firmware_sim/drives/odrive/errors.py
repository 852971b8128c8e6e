"""Errors of an ODrive axis: four sets of bits in firmware 0.5, two in 0.6."""

from __future__ import annotations

from typing import Final


class Errors05:
    """Error bits of firmware 0.5 that the twin detects."""

    AXIS_INVALID_STATE: Final = 0x00001
    AXIS_WATCHDOG: Final = 0x00800
    AXIS_ESTOP: Final = 0x04000
    MOTOR_CURRENT_LIMIT: Final = 0x1000
    MOTOR_OVER_TEMPERATURE: Final = 0x20000
    MOTOR_SYSTEM_LEVEL: Final = 0x1000000
    CONTROLLER_OVERSPEED: Final = 0x01


class Errors06:
    """Error bits of firmware 0.6 that the twin detects."""

    OVER_VOLTAGE: Final = 0x00000100
    UNDER_VOLTAGE: Final = 0x00000200
    CURRENT_LIMIT: Final = 0x00001000
    MOTOR_OVER_TEMPERATURE: Final = 0x00002000
    VELOCITY_LIMIT: Final = 0x00008000
    WATCHDOG: Final = 0x01000000
    ESTOP: Final = 0x02000000


class Errors:
    """Keeps the errors until they are cleared.

    Parameters
    ----------
    is_old
        Whether the firmware is 0.5.

    Attributes
    ----------
    axis, motor, encoder, controller
        Errors of firmware 0.5.
    active, reason
        Active errors and reason of the last disarming of firmware 0.6.
    """

    def __init__(self, *, is_old: bool) -> None:
        self.is_old = is_old
        self._causes: list[tuple[int, str]] = []
        self._reset()

    def _reset(self) -> None:
        self.axis = self.motor = self.encoder = self.controller = 0
        self.active = self.reason = 0

    def add(self, code: int, part: str, *, lasts: bool = False) -> None:
        """Set error bits of a part, of which firmware 0.6 has none; `lasts`: until `heal`."""
        if lasts:
            self._causes.append((code, part))
        if self.is_old:
            setattr(self, part, getattr(self, part) | code)
        else:
            self.reason |= code
            self.active |= code if lasts else 0

    def clear(self) -> None:
        """Forget the errors whose causes are gone."""
        self._reset()
        causes, self._causes = self._causes, []
        for code, part in causes:
            self.add(code, part, lasts=True)

    def heal(self) -> None:
        """Remove all causes and errors unasked, which no ODrive is documented to do."""
        self._causes.clear()
        self._reset()

    @property
    def has_expired(self) -> bool:
        """Whether the watchdog has expired."""
        if self.is_old:
            return bool(self.axis & Errors05.AXIS_WATCHDOG)
        return bool(self.reason & Errors06.WATCHDOG)

    @property
    def any(self) -> bool:
        """Whether there are errors."""
        parts = self.axis | self.motor | self.encoder | self.controller
        return bool(parts | self.active | self.reason)
