"""Parameters: values of the configuration that change while the robot runs."""

from __future__ import annotations

from typing import TypeAlias

import msgspec


class Tuning(msgspec.Struct, frozen=True, tag=True):
    """All values that differ now from those which the receiver began with.

    `values` are by their dotted keys in the robot's file; the receiver takes those that are of its
    own. `number` comes back in its state once they are taken; 0 where nothing differs.
    """

    stamp_ns: int
    values: dict[str, bool | int | float]
    number: int


class SetParameter(msgspec.Struct, frozen=True, tag=True):
    """Request to set a parameter; `value` None: to that of the robot's file."""

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
    """Answer to a `ParameterRequest`: why it was refused, empty if it was carried out."""

    request_id: int
    refusal: str


class ParameterFacts(msgspec.Struct, frozen=True, array_like=True):
    """Description of a parameter: its key in the robot's file, the file's value, and its range.

    `change` says when a new value takes effect, `is_fixed` that it stands in the file only,
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
    """All parameters of the robot, which stay while its processes run."""

    stamp_ns: int
    parameters: tuple[ParameterFacts, ...]


class ParameterValues(msgspec.Struct, frozen=True, tag=True):
    """Values of all parameters, in the order of `ParameterTable`.

    `wanted` are the values that were set; where one differs from that `in_force`, a restart
    brings the rest of it.
    """

    stamp_ns: int
    wanted: tuple[bool | int | float, ...]
    in_force: tuple[bool | int | float, ...]


ParameterNews: TypeAlias = ParameterAnswer | ParameterValues
