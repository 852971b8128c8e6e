"""Hardware interface of motor drives: commands and measurements of motors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from firmware_sim.plant.axis import BrakeResistor, Limits, Mode


class Encoder(Protocol):
    """Incremental encoder of an axis."""

    @property
    def count(self) -> int:
        """Quadrature counts, unbounded, positive forwards."""


class MotorAxis(Protocol):
    """One motor with its bridge and its sensors, of the plant or a fake, seen at the wheel."""

    limits: Limits
    """Limits and gains of the drive's loops; in force at once."""

    def command(self, mode: Mode, value: float = 0.0) -> None:
        """Command the bridge."""

    def encoder(self, counts_per_revolution: float) -> Encoder:
        """Return the encoder, with the drive's counts per turn of the wheel."""

    @property
    def speed_rad_s(self) -> float:
        """Speed measured by the encoder [rad/s], positive forwards."""

    @property
    def current_a(self) -> float:
        """Current of the motor [A], positive with forward torque."""

    @property
    def supply_current_a(self) -> float:
        """Mean current out of the supply [A]; negative feeds back."""

    @property
    def voltage_v(self) -> float:
        """Mean voltage at the motor [V]."""

    @property
    def temperature_c(self) -> float:
        """Winding temperature [degC]."""


class PowerStage(Protocol):
    """Parts shared by a robot's drives: axes, supply, steering servo."""

    @property
    def axes(self) -> Sequence[MotorAxis]:
        """Axes of the driven wheels, in the order of the drive's `wheel_names`."""

    @property
    def bus_voltage_v(self) -> float:
        """Supply at the bridges [V]."""

    @property
    def steering_rad(self) -> float:
        """Measured steering angle [rad], positive left."""

    def steer(self, angle_rad: float) -> None:
        """Demand an angle of the servo [rad]."""

    @property
    def brake_resistor_a(self) -> float:
        """Current through the brake resistor [A]."""

    def fit_brake_resistor(self, resistor: BrakeResistor | None) -> None:
        """Connect a brake resistor to the rail, or disconnect it."""


class UnfittedAxis:
    """A channel without a motor: at rest, and at air temperature.

    Parameters
    ----------
    temperature_c
        Air temperature [degC].
    """

    count = 0
    speed_rad_s = 0.0
    current_a = 0.0
    supply_current_a = 0.0
    voltage_v = 0.0

    def __init__(self, temperature_c: float) -> None:
        self.temperature_c = temperature_c
        self.limits = Limits()

    def command(self, mode: Mode, value: float = 0.0) -> None:
        """Do nothing."""

    def encoder(self, counts_per_revolution: float) -> Encoder:  # noqa: ARG002 - as of a motor
        """Return an encoder that stands still."""
        return self
