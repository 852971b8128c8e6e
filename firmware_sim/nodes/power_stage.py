"""Hardware interface of the motor controller's firmware."""

from __future__ import annotations

from typing import Protocol

from firmware_sim.plant.plant import Bridge


class PowerStage(Protocol):
    """The drive's actuators and sensors: the plant, or a fake.

    Counts are unbounded and signed, currents positive with forward torque, the steering angle
    positive to the left.
    """

    @property
    def count1(self) -> int:
        """Quadrature count of channel 1."""

    @property
    def count2(self) -> int:
        """Quadrature count of channel 2."""

    @property
    def current1_a(self) -> float:
        """Current of motor 1 [A]."""

    @property
    def current2_a(self) -> float:
        """Current of motor 2 [A]."""

    @property
    def temperature1_c(self) -> float:
        """Winding temperature of motor 1 [degC]."""

    @property
    def temperature2_c(self) -> float:
        """Winding temperature of motor 2 [degC]."""

    @property
    def bus_voltage_v(self) -> float:
        """Supply at the bridges [V]."""

    @property
    def steering_rad(self) -> float:
        """Measured steering angle [rad]."""

    def command(self, duty1: float, duty2: float, steering_rad: float, bridge: Bridge) -> None:
        """Set what the bridges and the servo do from now on."""
