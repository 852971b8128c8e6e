"""Write the page's TypeScript types of messages: `robotctl/web/page/src/wire/messages.ts`.

Call it after a change of a message that the page reads or sends; a test names a file that is old.
"""

from __future__ import annotations

import enum
import typing
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec
from msgspec import inspect

from firmware_sim.world import truth
from robotctl.messages.control import ControlState, NavigationState, Notice
from robotctl.messages.estimation import (
    CameraView,
    GivenMap,
    LidarScan,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
    SlamGraph,
)
from robotctl.messages.plans import BoundsView, MissionView
from robotctl.messages.recording import RecorderState
from robotctl.messages.tuning import ParameterTable, ParameterValues
from robotctl.web import recordings, replay_wire, wire

TARGET: Final = Path(__file__).resolve().parent.parent / "robotctl/web/page/src/wire/messages.ts"

Truth: Final = msgspec.defstruct(
    "Truth", [(each.name, each.type) for each in msgspec.structs.fields(truth.Truth)], tag=True
)
"""The truth of a simulation as the server sends it on: with a tag."""

ROBOT: Final[tuple[type, ...]] = (
    ControlState,
    NavigationState,
    LocalisationState,
    Notice,
    LidarScan,
    CameraView,
    ParticleCloud,
    PlanView,
    LiveMap,
    GivenMap,
    SlamGraph,
    MissionView,
    BoundsView,
    ParameterTable,
    ParameterValues,
    RecorderState,
    Truth,
)
"""Messages of the robot that the server passes on as they are published."""

FETCHED: Final = (*replay_wire.FETCHED, recordings.RecordingList)
"""Answers by HTTP."""

HEADER: Final = """\
// Written by tools/write_page_types.py from the messages of robotctl: do not edit.

/** How a struct that does not arrive as the object of its type becomes one. */
export interface Shape {
  /** Names of the fields of a struct that arrives as an array, in order. */
  readonly fields?: readonly string[];
  /** Structs in fields, by field; [] behind the name: an array of them. */
  readonly nested?: Readonly<Record<string, string>>;
}
"""


def structs_of(roots: Iterable[type]) -> list[inspect.StructType]:
    """Return the structs and all that are within them, each once, inner ones first."""
    found: dict[type, inspect.StructType] = {}

    def visit(kind: inspect.Type) -> None:
        for part in _parts(kind):
            visit(part)
        if isinstance(kind, inspect.StructType):
            found.setdefault(kind.cls, kind)

    for kind in inspect.multi_type_info(roots):
        visit(kind)
    return list(found.values())


def enums_of(structs: Iterable[inspect.StructType]) -> list[type[enum.Enum]]:
    """Return the enumerations in fields of the structs, each once."""
    found: dict[type[enum.Enum], None] = {}

    def visit(kind: inspect.Type) -> None:
        if isinstance(kind, inspect.EnumType):
            found.setdefault(kind.cls)
        elif not isinstance(kind, inspect.StructType):
            for part in _parts(kind):
                visit(part)

    for struct in structs:
        for each in struct.fields:
            visit(each.type)
    return list(found)


def _parts(kind: inspect.Type) -> Iterator[inspect.Type]:
    """Yield the types that a type is made of."""
    match kind:
        case inspect.StructType(fields=fields):
            yield from (each.type for each in fields)
        case inspect.UnionType(types=types) | inspect.TupleType(item_types=types):
            yield from types
        case inspect.NamedTupleType(fields=fields):
            yield from (each.type for each in fields)
        case inspect.VarTupleType(item_type=item):
            yield item
        case inspect.DictType(value_type=value):
            yield value
        case _:
            pass


_PLAIN: Final[dict[type[inspect.Type], str]] = {
    inspect.BoolType: "boolean",
    inspect.IntType: "number",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BytesType: "Uint8Array",
    inspect.NoneType: "null",
}


def typescript(kind: inspect.Type) -> str:
    """Return a type in TypeScript.

    Raises
    ------
    ValueError
        For a type that no message of the page has had so far.
    """
    if (plain := _PLAIN.get(type(kind))) is not None:
        return plain
    match kind:
        case inspect.EnumType(cls=cls) | inspect.StructType(cls=cls):
            return cls.__name__
        case inspect.UnionType(types=types):
            return " | ".join(dict.fromkeys(map(typescript, types)))
        case inspect.TupleType(item_types=types):
            return f"readonly [{', '.join(map(typescript, types))}]"
        case inspect.NamedTupleType(fields=fields):
            named = [f"{each.name}: {typescript(each.type)}" for each in fields]
            return f"readonly [{', '.join(named)}]"
        case inspect.VarTupleType(item_type=item):
            inner = typescript(item)
            return f"readonly ({inner})[]" if " " in inner else f"readonly {inner}[]"
        case inspect.DictType(value_type=value):
            return f"Readonly<Record<string, {typescript(value)}>>"
        case _:
            raise ValueError(f"{kind}: no message of the page had such a type so far; add it here")


def interface(struct: inspect.StructType) -> str:
    """Return a struct as an interface."""
    tag = [f'  readonly type: "{struct.tag}";'] if struct.tag is not None else []
    fields = [f"  readonly {each.encode_name}: {typescript(each.type)};" for each in struct.fields]
    return "\n".join((f"export interface {struct.cls.__name__} {{", *tag, *fields, "}\n"))


def enumeration(kind: type[enum.Enum]) -> str:
    """Return an enumeration as a table and the type of its values."""
    name = kind.__name__
    members = [f"  {member.name}: {member.value}," for member in kind]
    values = f"export type {name} = (typeof {name})[keyof typeof {name}];\n"
    return "\n".join((f"export const {name} = {{", *members, "} as const;", values))


def shape(struct: inspect.StructType, positional: frozenset[type]) -> str:
    """Return how an object is made of what arrives; empty if it arrives as one."""
    nested = {
        each.encode_name: f"{found}{'[]' if many else ''}"
        for each in struct.fields
        for found, many in _nested(each.type, positional)
    }
    parts = []
    if struct.array_like:
        names = ", ".join(f'"{each.encode_name}"' for each in struct.fields)
        parts.append(f"    fields: [{names}],")
    if nested:
        inner = ", ".join(f'{name}: "{found}"' for name, found in nested.items())
        parts.append(f"    nested: {{ {inner} }},")
    return "\n".join((f"  {struct.cls.__name__}: {{", *parts, "  },")) if parts else ""


def _nested(
    kind: inspect.Type, positional: frozenset[type], *, many: bool = False
) -> Iterator[tuple[str, bool]]:
    """Yield the struct within a field's type that arrives as an array, or has one that does."""
    match kind:
        case inspect.StructType(cls=cls) if cls in positional:
            yield cls.__name__, many
        case inspect.UnionType(types=types):
            for each in types:
                yield from _nested(each, positional, many=many)
        case inspect.VarTupleType(item_type=item):
            yield from _nested(item, positional, many=True)
        case _:
            pass


def positional_structs(structs: Iterable[inspect.StructType]) -> frozenset[type]:
    """Return the structs that arrive as arrays, or have such within."""
    found: set[type] = set()
    for struct in structs:  # inner ones come first
        inner = {each for field in struct.fields for each in _classes(field.type)}
        if struct.array_like or not inner.isdisjoint(found):
            found.add(struct.cls)
    return frozenset(found)


def _classes(kind: inspect.Type) -> Iterator[type]:
    if isinstance(kind, inspect.StructType):
        yield kind.cls
    else:
        for part in _parts(kind):
            yield from _classes(part)


def union(name: str, members: Iterable[type]) -> str:
    """Return a union of messages."""
    return f"export type {name} =\n" + "\n".join(f"  | {each.__name__}" for each in members) + ";\n"


def text() -> str:
    """Return the content of the file."""
    replayed = typing.get_args(replay_wire.ReplayMessage)
    sent = tuple(dict.fromkeys((*typing.get_args(wire.LiveMessage), *replayed)))
    received = (*ROBOT, wire.Hello, *wire.Downward.__subclasses__())
    roots = (*received, *sent, *typing.get_args(wire.StopMessage), *FETCHED)
    structs = structs_of(dict.fromkeys(roots))
    positional = positional_structs(structs)
    shapes = filter(None, (shape(struct, positional) for struct in structs))
    return "\n".join(
        (
            HEADER,
            *map(enumeration, enums_of(structs)),
            *map(interface, structs),
            union("Received", received),
            union("Sent", sent),
            "export const SHAPES: Readonly<Record<string, Shape>> = {",
            *shapes,
            "};\n",
        )
    )


def main() -> None:
    """Write the file."""
    TARGET.write_text(text(), encoding="utf-8")


if __name__ == "__main__":
    main()
