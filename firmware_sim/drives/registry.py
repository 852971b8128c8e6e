"""`TWINS`: every kind of drive that has a twin, and the true drives of a robot."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError

from firmware_sim.config.motors import OWN_KIND, MotorTable
from firmware_sim.drives.cia402.config import Cia402Motor
from firmware_sim.drives.config import MotorSection
from firmware_sim.drives.moteus.config import MoteusMotor
from firmware_sim.drives.odrive.config import ODriveMotor
from firmware_sim.drives.vesc.config import VescMotor
from firmware_sim.errors import SimulationError, nearest

TWINS: Final[Mapping[str, type[MotorSection]]] = {
    "cia402": Cia402Motor,
    "odrive": ODriveMotor,
    "vesc": VescMotor,
    "moteus": MoteusMotor,
}
"""Classes of the tables, by `kind`."""


def true_drive(table: MotorTable, found: Mapping[str, Any]) -> tuple[MotorSection, Any]:
    """Return the true drive, and the settings of its twin.

    Parameters
    ----------
    table
        The drive of the file.
    found
        Its table `[simulation.twin.NAME]`: true values of keys of `[[motor]]`, and settings of the
        twin.

    Raises
    ------
    SimulationError
        If the kind or a key is unknown, or a value is invalid.
    """
    section = TWINS.get(table.kind)
    if section is None:
        kinds = [OWN_KIND, *TWINS]
        hint = nearest(table.kind, kinds) or f", allowed: {', '.join(kinds)}"
        raise SimulationError(f"motor {table.name}: no kind {table.kind!r}{hint}")
    names = {each.name for each in dataclasses.fields(section)}  # type: ignore[arg-type]
    true = {key: value for key, value in found.items() if key in names}
    others = {key: value for key, value in found.items() if key not in names}
    drive = _validated(f"motor {table.name}", section, {**table.keys, **true})
    return drive, _validated(f"simulation.twin.{table.name}", section.Settings, others)


@cache
def _validator(kind: type) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _validated(table: str, kind: type, values: Mapping[str, Any]) -> Any:
    """Return the value of a table; raises SimulationError with its first error."""
    try:
        return _validator(kind).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        problem = f"{first['msg']}, found {first['input']!r}"
        raise SimulationError(f"{table}: {key}: {problem}") from error
