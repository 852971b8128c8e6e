"""Options of a command, defined once: as the fields of the dataclass that it works with."""

from __future__ import annotations

import copy
import functools
import inspect
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from typer.models import ParameterInfo


def takes_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that takes the fields of options classes one by one, as typer reads them.

    A parameter whose type is a dataclass stands for those of its fields that are annotated with a
    `typer.Option` or a `typer.Argument`, and is given the object made from them. Where it is
    `partial[Dataclass]`, the command itself adds the rest. Any may be a `tuple[X, ...]`, which
    typer does not know.
    """
    hints = get_type_hints(command, include_extras=True)
    parameters: dict[str, inspect.Parameter] = {}
    makers: dict[str, tuple[Callable[..., Any], list[str]]] = {}
    values: dict[str, Callable[[Any], Any]] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        hint = hints[name]
        is_partial = get_origin(hint) is functools.partial
        target = get_args(hint)[0] if is_partial else hint
        options = {name: (hint, parameter.default)}
        is_class = is_dataclass(target)
        if is_class:
            options = _options(target)
            make: Callable[..., Any] = functools.partial(functools.partial, target)
            makers[name] = make if is_partial else target, list(options)
        for key, (kind, default) in options.items():
            parameters[key] = _parameter(key, kind, default)
            values[key] = functools.partial(_value, _info(kind), default)

    @functools.wraps(command)
    def run(**given: Any) -> None:
        made = {key: values[key](each) for key, each in given.items()}
        for name, (make, keys) in makers.items():
            made[name] = make(**{key: made.pop(key) for key in keys})
        command(**made)

    run.__signature__ = inspect.Signature(list(parameters.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {key: each.annotation for key, each in parameters.items()}
    return run


def _info(hint: Any) -> ParameterInfo | None:
    """Return what typer is told of an option; None of what is none."""
    found = (each for each in getattr(hint, "__metadata__", ()) if isinstance(each, ParameterInfo))
    return next(found, None)


def _options(target: Any) -> dict[str, tuple[Any, Any]]:
    """Return type and default of the fields of a dataclass that users give."""
    hints = get_type_hints(target, include_extras=True)
    return {
        field.name: (
            hints[field.name],
            inspect.Parameter.empty if field.default is MISSING else field.default,
        )
        for field in fields(target)
        if _info(hints[field.name]) is not None
    }


def _parameter(name: str, hint: Any, default: Any) -> inspect.Parameter:
    """Return an option as typer reads it; what has a parser is a text to it."""
    info = _info(hint)
    if info is not None:
        kind = get_args(hint)[0]
        if info.parser is not None:
            info = copy.copy(info)
            info.parser, kind = None, str
            default = str(default) if isinstance(default, Path) else default
        elif get_origin(kind) is tuple:
            kind = list[get_args(kind)[0]]  # type: ignore[misc]
        if default in (None, ()):
            kind, default = kind | None, None
        hint = Annotated[kind, info]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)


def _value(info: ParameterInfo | None, default: Any, given: Any) -> Any:
    """Return the value of an option: its default, or what its parser makes of what was given.

    Files are looked for only now, not when the shell completes a command line.
    """
    if given is None and default is not inspect.Parameter.empty:
        return default
    if info is not None and info.parser is not None:
        return info.parser(given)
    return tuple(given) if isinstance(given, list) else given
