"""What a message of a log must be: judged by jsonschema, and by what viewers of logs understand."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import IO, Any

import jsonschema
from mcap.reader import make_reader

UNDERSTOOD = {"title", "description", "required"}
"""Beside the type: viewers follow no references and no alternatives."""


def check_schema(schema: dict[str, Any], place: str = "") -> None:
    """Check that viewers build their list of fields from a schema without an error."""
    kind = schema["type"]
    inner = {"object": {"properties"}, "array": {"items"}, "string": {"contentEncoding"}}
    assert set(schema) - {"type"} <= UNDERSTOOD | inner.get(kind, set()), place
    if kind == "object":
        for name, part in schema["properties"].items():
            check_schema(part, f"{place}.{name}")
    if kind == "array":
        check_schema(schema["items"], f"{place}[]")


def unknown_fields(value: object, schema: dict[str, Any], place: str = "") -> list[str]:
    """Return the places of what a schema does not name."""
    if isinstance(value, dict):
        known = schema["properties"]
        return [f"{place}.{name}" for name in value if name not in known] + [
            found
            for name, part in value.items()
            if name in known
            for found in unknown_fields(part, known[name], f"{place}.{name}")
        ]
    if isinstance(value, list):
        return [
            found for part in value for found in unknown_fields(part, schema["items"], f"{place}[]")
        ]
    return []


def strict_json(data: bytes) -> Any:
    """Return what JSON says, which has no word for nan and infinity."""

    def refuse(word: str) -> None:
        raise AssertionError(word)

    return json.loads(data, parse_constant=refuse)


def checked_topics(source: Path | IO[bytes]) -> Counter[str]:
    """Check every message of a log against the schema in it; return how many each topic has."""
    counts: Counter[str] = Counter()
    validators: dict[int, jsonschema.Draft202012Validator] = {}
    with source.open("rb") if isinstance(source, Path) else source as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            if schema.id not in validators:
                content = json.loads(schema.data)
                jsonschema.Draft202012Validator.check_schema(content)
                check_schema(content, channel.topic)
                validators[schema.id] = jsonschema.Draft202012Validator(content)
            value = strict_json(message.data)
            validators[schema.id].validate(value)
            assert not unknown_fields(value, validators[schema.id].schema, channel.topic)
            counts[channel.topic] += 1
    return counts
