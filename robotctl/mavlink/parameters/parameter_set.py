"""The parameters of one robot: what they are, what is wanted, and what of it is in force."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import common

from robotctl.config_values import Rules, Value, problems, replaced, value_at
from robotctl.dialect import additions
from robotctl.errors import InvalidValue
from robotctl.mavlink.parameters.parameter import (
    INT32,
    REAL32,
    Change,
    Parameter,
    kind_of,
    shortest,
    single,
)
from robotctl.mavlink.parameters.table import PARAMETERS
from robotctl.mavlink.parameters.words import words


class ParamError(enum.IntEnum):
    """Why a parameter cannot be read or set: MAV_PARAM_ERROR."""

    DOES_NOT_EXIST = common.MAV_PARAM_ERROR_DOES_NOT_EXIST
    VALUE_OUT_OF_RANGE = common.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
    READ_ONLY = common.MAV_PARAM_ERROR_READ_ONLY
    TYPE_UNSUPPORTED = additions.MAV_PARAM_ERROR_TYPE_UNSUPPORTED
    TYPE_MISMATCH = additions.MAV_PARAM_ERROR_TYPE_MISMATCH


class ParameterRefused(Exception):  # noqa: N818 - is answered, no defect
    """A value is not taken; the text says what was found and what is allowed."""

    def __init__(self, problem: ParamError, text: str) -> None:
        super().__init__(text)
        self.problem = problem


class Facts(NamedTuple):
    """Description of a parameter for people."""

    parameter: Parameter
    default: Value
    unit: str
    """Empty: it has none."""
    description: str


class Configurations(NamedTuple):
    """The robot's configuration, as the parameters see it: any tree of frozen dataclasses.

    Parameters
    ----------
    file
        That of the robot's file, which the values are measured against.
    began
        That with which the processes began.
    rules
        What no value alone shows.
    """

    file: Any
    began: Any
    rules: Rules


class ParameterSet:
    """The parameters that a robot has, in the order of their indices.

    Parameters
    ----------
    configurations
        Of the robot.
    wanted
        Values that differ from the file's, by dotted key; all of them are allowed.
    table
        The parameters that there are.
    """

    def __init__(
        self,
        configurations: Configurations,
        wanted: Mapping[str, Value],
        table: Sequence[Parameter] = PARAMETERS,
    ) -> None:
        self._file, self._began, self._rules = configurations
        self._wanted = self._file
        for key, value in wanted.items():
            self._wanted = replaced(self._wanted, key, value)
        self._now = self._began
        self.parameters = tuple(
            each for each in table if _is_finite(value_at(self._file, each.key))
        )
        """The parameters, by index."""
        self._index = {each.name: index for index, each in enumerate(self.parameters)}
        for parameter in self.parameters:
            self._take_effect(parameter)

    def index_of(self, name: str) -> int | None:
        """Return the index of a name; None: there is none."""
        return self._index.get(name)

    def value(self, parameter: Parameter) -> Value:
        """Return the value that is wanted, which a restart brings if it is not in force yet."""
        return _present(self._wanted, parameter)

    def default(self, parameter: Parameter) -> Value:
        """Return the value of the robot's file."""
        return _present(self._file, parameter)

    def in_force(self, parameter: Parameter) -> Value:
        """Return the value that is in force."""
        return _present(self._now, parameter)

    def facts(self) -> list[Facts]:
        """Return what people should know of each."""
        return [
            Facts(each, self.default(each), *words(self._file, each.key))
            for each in self.parameters
        ]

    def set(self, parameter: Parameter, raw: float, kind: int) -> str:
        """Take a value; return what is to be said of it, empty where it is the present one.

        Parameters
        ----------
        raw
            The number of PARAM_SET.
        kind
            Its MAV_PARAM_TYPE: that of the parameter. A whole number may come as a float, too,
            because many send nothing else.

        Raises
        ------
        ParameterRefused
            If it is not allowed.
        """
        old = self.value(parameter)
        wanted = self._with(parameter, raw, kind)
        value = _present(wanted, parameter)
        if value == old:
            return ""
        self._wanted = wanted
        self._take_effect(parameter)
        now = self.in_force(parameter)
        said = f"{_text(old)} -> {_text(value)}"
        return said if now == value else f"{said} after a restart, {_text(now)} until then"

    def reset(self) -> list[tuple[Parameter, str]]:
        """Take the values of the robot's file; return which changed, and what is to be said."""
        changed = [(each, self.value(each)) for each in self.parameters]
        self._wanted = self._file
        for parameter, _ in changed:
            self._take_effect(parameter)
        return [
            (parameter, f"{_text(old)} -> {_text(self.value(parameter))}")
            for parameter, old in changed
            if old != self.value(parameter)
        ]

    def allowed(self, parameter: Parameter, raw: float) -> Value:
        """Return a value that might be set, without doing it; raises as `set`."""
        return _present(self._with(parameter, raw, REAL32), parameter)

    def _with(self, parameter: Parameter, raw: float, kind: int) -> Any:
        """Return the wanted configuration with another value; raises as `set`."""
        old = self.value(parameter)
        value = _checked(parameter, raw, kind, old, _present(self._file, parameter))
        try:
            wanted = replaced(self._wanted, parameter.key, value)
        except InvalidValue as error:
            text = f"{parameter.name}: {error}"
            raise ParameterRefused(ParamError.VALUE_OUT_OF_RANGE, text) from None
        if wrong := problems(wanted, self._rules):
            text = f"{parameter.name}: {'; '.join(wrong)}"
            raise ParameterRefused(ParamError.VALUE_OUT_OF_RANGE, text)
        return wanted

    def _take_effect(self, parameter: Parameter) -> None:
        """Bring into force what of a wanted value may be had at once."""
        began_with = _present(self._began, parameter)
        value = parameter.change.nearest(self.value(parameter), began_with)
        if value == _present(self._now, parameter):
            return
        try:
            now = replaced(self._now, parameter.key, value)
        except InvalidValue:  # only with others that wait for a restart
            return
        if not problems(now, self._rules):
            self._now = now

    @property
    def now(self) -> Any:
        """The configuration in force."""
        return self._now

    def changes(self) -> dict[str, Value]:
        """Return the wanted values that differ from the file's, by dotted key."""
        return self._differences(self._file, self._wanted)

    def live(self) -> dict[str, Value]:
        """Return the values in force that the processes did not begin with, by dotted key."""
        return self._differences(self._began, self._now)

    def _differences(self, before: object, after: object) -> dict[str, Value]:
        pairs = (
            (each.key, _present(before, each), _present(after, each)) for each in self.parameters
        )
        return {key: new for key, old, new in pairs if new != old}


NO_PARAMETERS: Final = ParameterSet(Configurations(None, None, lambda _: ()), {}, ())


def _checked(parameter: Parameter, raw: float, kind: int, old: Value, default: Value) -> Value:
    """Return the value that a number of PARAM_SET means."""
    name = parameter.name
    if parameter.change is Change.NEVER:
        raise ParameterRefused(ParamError.READ_ONLY, f"{name} stands in the robot's file only")
    if kind not in {INT32, REAL32}:
        text = f"{name}: type {kind} found, no parameter is of that; {kind_of(old)} allowed"
        raise ParameterRefused(ParamError.TYPE_UNSUPPORTED, text)
    if kind not in {kind_of(old), REAL32}:
        raise ParameterRefused(
            ParamError.TYPE_MISMATCH, f"{name}: type {kind} found, {kind_of(old)} allowed"
        )
    if not math.isfinite(raw):
        raise ParameterRefused(ParamError.VALUE_OUT_OF_RANGE, f"{name}: {raw} is no number")
    if not isinstance(old, float) and raw != int(raw):
        raise ParameterRefused(
            ParamError.TYPE_MISMATCH, f"{name}: {raw:g} found, a whole number allowed"
        )
    if isinstance(old, bool) and raw not in {0.0, 1.0}:
        raise ParameterRefused(
            ParamError.VALUE_OUT_OF_RANGE, f"{name}: {raw:g} found, 0 or 1 allowed"
        )
    value = shortest(raw) if isinstance(old, float) else type(old)(raw)
    if single(default) == single(value):
        return default
    if not single(parameter.low) <= raw <= single(parameter.high):
        allowed = f"{parameter.low:g} to {parameter.high:g} allowed"
        raise ParameterRefused(ParamError.VALUE_OUT_OF_RANGE, f"{name}: {raw:g} found, {allowed}")
    return value


def _present(config: object, parameter: Parameter) -> Value:
    """Return the value of a parameter that the robot has."""
    value = value_at(config, parameter.key)
    if value is None:
        raise KeyError(parameter.key)
    return value


def _is_finite(value: Value | None) -> bool:
    return value is not None and math.isfinite(value)


def _text(value: Value) -> str:
    return f"{int(value)}" if isinstance(value, bool) else f"{value:g}"
