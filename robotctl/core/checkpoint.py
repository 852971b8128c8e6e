"""The control core's state as bytes, and back, without letting a file run code.

Checkpoints are pickles, the only form that keeps every attribute, floats to the bit, as long as
the core and its parts are plain objects. A pickle may name any callable; reading one lets in
nothing but classes of the layers that do no input or output, and a few containers.
"""

from __future__ import annotations

import dataclasses
import enum
import io
import pickle
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

import msgspec

from robotctl.core.control_core import ControlCore
from robotctl.errors import RobotctlError

_PURE: Final = (
    "robotctl.model.",
    "robotctl.control.",
    "robotctl.estimation.",
    "robotctl.messages.",
    "robotctl.safety.",
    "robotctl.core.",
)
_CONTAINERS: Final = frozenset(
    {
        ("builtins", "bytearray"),
        ("builtins", "complex"),
        ("builtins", "frozenset"),
        ("builtins", "set"),
        ("collections", "OrderedDict"),
        ("collections", "deque"),
    }
)
_PROTOCOL: Final = 5


class CheckpointError(RobotctlError):
    """A checkpoint cannot be read."""


def checkpoint(core: ControlCore) -> bytes:
    """Return the state of a core; some 60 us and 4 kB for a differential drive.

    Raises
    ------
    TypeError, AttributeError, pickle.PicklingError
        If a part of it is no plain object.
    """
    return pickle.dumps(core, _PROTOCOL)


def restored(data: bytes) -> ControlCore:
    """Return the core of a checkpoint.

    Raises
    ------
    CheckpointError
        If the data are damaged, or of a robotctl with other classes.
    """
    try:
        core = _Unpickler(io.BytesIO(data)).load()
    except (
        pickle.UnpicklingError,
        ArithmeticError,
        AttributeError,
        EOFError,
        ImportError,
        LookupError,
        MemoryError,
        TypeError,
        ValueError,
    ) as error:
        raise CheckpointError(f"the checkpoint cannot be read: {error}") from error
    if not isinstance(core, ControlCore):
        raise CheckpointError(f"the checkpoint holds a {type(core).__name__}, not a ControlCore")
    return core


def fields_of(core: ControlCore) -> dict[str, tuple[str, ...]]:
    """Return the attributes of a core and of all its parts, by the names of their classes.

    Where they stand in a pickle by place and not by name, they are in that order.
    """
    found: dict[str, tuple[str, ...]] = {}
    parts: list[Any] = [core]
    while parts:
        part = parts.pop()
        kind = type(part)
        if isinstance(part, tuple | list | deque):
            parts += part
        elif isinstance(part, dict):
            parts += part.values()
        elif kind.__module__.startswith(_PURE) and not isinstance(part, enum.Enum):
            names = found[f"{kind.__module__}.{kind.__qualname__}"] = _names(part)
            parts += (getattr(part, name, None) for name in names)
    return found


def misfit(before: Mapping[str, tuple[str, ...]], now: Mapping[str, tuple[str, ...]]) -> str:
    """Say the first difference between the fields of two cores; empty without one.

    Parameters
    ----------
    before
        Of the core that was recorded.
    now
        Of one that is made here, with the same configuration.
    """
    for kind in sorted(before.keys() | now.keys()):
        old, new = before.get(kind), now.get(kind)
        if old == new:
            continue
        if old is None or new is None:
            return f"{kind} is not here" if new is None else f"{kind} was not there"
        if gone := [name for name in old if name not in new]:
            return f"{kind} had {', '.join(gone)}, which it has not here"
        if more := [name for name in new if name not in old]:
            return f"{kind} has {', '.join(more)} here, which it had not"
        return f"{kind} had {', '.join(old)} in this order"
    return ""


def _names(part: object) -> tuple[str, ...]:
    """Return the names of an object's attributes."""
    if isinstance(part, msgspec.Struct):
        return part.__struct_fields__
    if dataclasses.is_dataclass(part):
        return tuple(field.name for field in dataclasses.fields(part))
    return tuple(sorted(vars(part) if hasattr(part, "__dict__") else part.__slots__))  # type: ignore[attr-defined]


def _member(kind: object, name: str) -> enum.Enum:
    """Return a member of an enumeration: Python 3.11.0 to 3.11.3 write it as an attribute."""
    if isinstance(kind, type) and issubclass(kind, enum.Enum) and name in kind.__members__:
        return kind.__members__[name]
    raise pickle.UnpicklingError(f"{name} of {kind!r} is not allowed in a checkpoint")


class _Unpickler(pickle.Unpickler):
    """Resolves names of harmless classes only."""

    def find_class(self, module_name: str, global_name: str, /) -> Any:
        """Return a class that may be in a checkpoint."""
        if (module_name, global_name) == ("builtins", "getattr"):
            return _member
        if (module_name, global_name) in _CONTAINERS:
            return super().find_class(module_name, global_name)
        if module_name.startswith(_PURE) and "." not in global_name:
            found = super().find_class(module_name, global_name)
            if isinstance(found, type) and found.__module__ == module_name:
                return found
        raise pickle.UnpicklingError(f"{module_name}.{global_name} is not allowed in a checkpoint")
