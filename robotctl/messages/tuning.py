"""Parameters: values of the configuration that change while the robot runs."""

from __future__ import annotations

from typing import TypeAlias

import msgspec


class Tuning(msgspec.Struct, frozen=True, tag=True):
    """All values that now differ from those at the receiver's start.

    `values` have their dotted keys in the robot's file; the receiver takes its own. `number` comes
    back in its state once they are in force; 0 if nothing differs.
    """

    stamp_ns: int
    values: dict[str, bool | int | float]
    number: int


class SetParameter(msgspec.Struct, frozen=True, tag=True):
    """Request to set a parameter; `value` None: the value of the robot's file."""

    stamp_ns: int
    request_id: int
    name: str
    value: float | None


class ResetParameters(msgspec.Struct, frozen=True, tag=True):
    """Request to set all parameters to the values of the robot's file."""

    stamp_ns: int
    request_id: int


ParameterRequest: TypeAlias = SetParameter | ResetParameters


class ParameterAnswer(msgspec.Struct, frozen=True, tag=True):
    """Answer to a `ParameterRequest`: reason of refusal, empty if accepted."""

    request_id: int
    refusal: str


class ParameterFacts(msgspec.Struct, frozen=True, array_like=True):
    """Description of a parameter: its key in the robot's file, the file's value, and its range.

    `change` is when a new value takes effect, `is_fixed` means that only the file sets it,
    `is_whole` that it is a whole number.
    """

    name: str
    key: str
    default: bool | int | float
    low: float
    high: float
    unit: str
    description: str
    change: str
    is_fixed: bool
    is_whole: bool


class ParameterTable(msgspec.Struct, frozen=True, tag=True):
    """All parameters of the robot, constant while its processes run."""

    stamp_ns: int
    parameters: tuple[ParameterFacts, ...]


class ParameterValues(msgspec.Struct, frozen=True, tag=True):
    """Values of all parameters, in the order of `ParameterTable`.

    `wanted` are the set values; one that differs from that `in_force` takes effect at a restart.
    """

    stamp_ns: int
    wanted: tuple[bool | int | float, ...]
    in_force: tuple[bool | int | float, ...]


ParameterNews: TypeAlias = ParameterAnswer | ParameterValues
