"""Gains and limits of a running controller, changed without a bump."""

from __future__ import annotations

from robotctl.config_values import tuned
from robotctl.control.limiter import LimitsConfig
from robotctl.control.wheel_loop import WheelLoop
from robotctl.control.wheels import WheelControl
from robotctl.core.config import ControlConfig
from robotctl.core.driving import Driving
from robotctl.errors import InvalidValue
from robotctl.messages.control import Notice, Severity
from robotctl.messages.tuning import Tuning


class Tuner:
    """Applies each `Tuning` to the settings of the start.

    Parameters
    ----------
    control, limits
        Settings at the start.
    wheels, duty_wheels
        Wheel controls to retune, and the names of those with a loop of ours.
    driving
        Owner of the limiter.

    Attributes
    ----------
    number
        Number of the tuning in force.
    powerless
        Reasons against arming that a file cannot be refused for: it may be one to be tuned.
    """

    def __init__(
        self,
        control: ControlConfig,
        limits: LimitsConfig,
        wheels: tuple[WheelControl, ...],
        duty_wheels: tuple[str, ...],
        driving: Driving,
    ) -> None:
        self.number = 0
        self.powerless = control.powerless(duty_wheels)
        self._began_with = {"control": control, "limits": limits}
        self._loops = [wheel for wheel in wheels if isinstance(wheel, WheelLoop)]
        self._duty_wheels = duty_wheels
        self._driving = driving

    def take(self, tuning: Tuning) -> Notice | None:
        """Apply other gains and limits; a refusal changes nothing and is returned as a notice."""
        try:
            tables = tuned(self._began_with, tuning.values)
        except InvalidValue as error:
            text = f"tuning refused: {error}"
            return Notice(tuning.stamp_ns, Severity.WARNING, text)
        control: ControlConfig = tables["control"]
        for loop, pid in zip(self._loops, control.loops(self._duty_wheels), strict=True):
            loop.retune(pid)
        self.powerless = control.powerless(self._duty_wheels)
        self._driving.retune(tables["limits"])
        self.number = tuning.number
        return None
