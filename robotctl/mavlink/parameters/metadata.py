"""MAVLink's component metadata for ground stations, JSON.

https://mavlink.io/en/services/component_information.html; the schemas are general.schema.json and
parameter.schema.json of the MAVLink repository.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any, Final

from robotctl.mavlink.parameters.parameter import Change
from robotctl.mavlink.parameters.parameter_set import Facts, ParameterSet

PARAMETERS: Final = 1
EVENTS: Final = 4
"""COMP_METADATA_TYPE."""
_FIGURES: Final = 4
"""Decimal places that stations show."""


def parameter_metadata(parameters: ParameterSet) -> bytes:
    """Return names, units, ranges, defaults and descriptions."""
    entries = [_entry(fact) for fact in parameters.facts()]
    return json.dumps({"version": 1, "parameters": entries}).encode()


def _entry(fact: Facts) -> dict[str, Any]:
    parameter, default, unit, description = fact
    short = description.split(". ")[0].rstrip(".")
    group = parameter.name.partition("_")[0]
    is_float = isinstance(default, float)
    entry: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float" if is_float else "Int32",
        "group": group,
        "shortDesc": short,
        "longDesc": f"{description} In the robot's file: {parameter.key}. "
        f"Changes {parameter.change.value}.",
        "default": default if is_float else int(default),
        "min": float(parameter.low) if is_float else int(parameter.low),
        "max": float(parameter.high) if is_float else int(parameter.high),
        "rebootRequired": parameter.change is Change.RESTART,
        "volatile": False,
    }
    if unit:
        entry["units"] = unit
    if is_float:
        entry["decimalPlaces"] = _FIGURES
    if isinstance(default, bool):
        entry["values"] = [{"value": 0, "description": "no"}, {"value": 1, "description": "yes"}]
    return entry


def general_metadata(files: Mapping[int, tuple[str, bytes]]) -> bytes:
    """Return where metadata are, and their checksums.

    Parameters
    ----------
    files
        URI and content, by COMP_METADATA_TYPE.
    """
    where = [
        {"type": kind, "uri": uri, "fileCrc": file_crc(content)}
        for kind, (uri, content) in files.items()
    ]
    return json.dumps({"version": 1, "metadataTypes": where}).encode()


def file_crc(content: bytes) -> int:
    """Return the CRC-32 of a file as MAVLink FTP has it: it begins with 0, nothing is inverted."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF
