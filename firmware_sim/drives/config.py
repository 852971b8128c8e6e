"""A kind of drive in the simulator: the class of its table `[[motor]]`."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Protocol

from firmware_sim.config.motors import AxisSection
from firmware_sim.drives.twin import Motor, Twin
from firmware_sim.nodes.parameter_store import ParameterStore
from firmware_sim.nodes.power_stage import PowerStage

__all__ = ["AxisSection", "Guard", "MotorSection"]


class Guard(enum.Enum):
    """Dangers against which a drive may guard itself."""

    CURRENT = "current"
    HEAT = "temperature"


class MotorSection(Protocol):
    """A table `[[motor]]`: one drive of one kind, and how to make its twin."""

    Settings: ClassVar[Any]
    """Class of its table `[simulation.twin.NAME]`, besides the keys of this class: true properties
    of the drive, whatever the rest of the file states."""

    FAULT_CODES: ClassVar[range]
    """Range of its own fault codes."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def frames(self) -> tuple[int, ...]:
        """Identifiers, with flags as in `Frame`, of its frames and of the host's frames to it."""

    def guards(self, settings: Any) -> frozenset[Guard]:
        """Return the dangers against which it guards itself, with its `Settings`."""

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
            Motors of the axes that turn wheels, in the order of the axes.
        stage
            Power stage: supply and steering servo.
        run_to
            As for `Twin`.
        store
            Its non-volatile memory.
        """
