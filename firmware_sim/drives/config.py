"""A kind of drive as the simulator knows it: the class of its table `[[motor]]`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Protocol

from firmware_sim.config.motors import AxisSection
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage

__all__ = ["AxisSection", "MotorSection"]


class MotorSection(Protocol):
    """A table `[[motor]]`: one drive of one kind, of which this is the twin."""

    Settings: ClassVar[Any]
    """Class of its table `[simulation.twin.NAME]`, besides the keys of this class: what is true of
    the drive, whatever the rest of the file believes."""

    @property
    def axes(self) -> tuple[AxisSection, ...]:
        """Its axes."""

    def make(
        self,
        settings: Any,
        motors: Sequence[Motor],
        stage: PowerStage,
        run_to: Callable[[int], int],
        store: ParameterStore,
    ) -> Twin:
        """Return the twin.

        Parameters
        ----------
        settings
            Its `Settings`.
        motors
            Motors on its axes that turn wheels, in their order.
        stage
            Supply and steering servo.
        run_to
            For `Twin`.
        store
            Its non-volatile memory.
        """
