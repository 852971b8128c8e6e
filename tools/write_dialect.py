"""Write the messages of robotctl's dialect that pymavlink's `common` lacks, by its generator.

`robotctl/dialect/robotctl.xml` is the source; see docs/decisions.md, 60.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pymavlink.dialects.v20
from pymavlink.dialects.v20 import common
from pymavlink.generator import mavgen_python, mavparse

SOURCE = Path(__file__).parents[1] / "robotctl" / "dialect" / "robotctl.xml"
TARGET = SOURCE.with_name("additions.py")
BUNDLED = Path(pymavlink.dialects.v20.__path__[0])
WANTED = ("AVAILABLE_MODES", "AVAILABLE_MODES_MONITOR", "CURRENT_MODE", "EKF_STATUS_REPORT")
"""Of what `all.xml` has and `common` lacks, as generated code is long."""

HEAD = '''\
"""Messages of robotctl's dialect that pymavlink's `common` lacks.

Written by tools/write_dialect.py from robotctl.xml: change that, and run it.
"""

import struct
from typing import Dict, Sequence, Union

from pymavlink.dialects.v20.common import MAVLink_message, mavlink_msg_deprecated_name_property
'''


def written() -> str:
    """Return the module."""
    paths = [SOURCE, *_included(SOURCE)]
    with contextlib.redirect_stdout(io.StringIO()):  # remarks on the bundled files
        files = [mavparse.MAVXML(str(path), mavparse.PROTOCOL_2_0) for path in paths]
    own, *others = files
    more = [each for file in others for each in file.message if each.name in WANTED]
    messages = sorted([*own.message, *more], key=lambda each: each.id)
    bundled = {
        number for number, kind in common.mavlink_map.items() if kind.__module__ == common.__name__
    }
    if twice := [each.name for each in messages if each.id in bundled]:
        raise ValueError(f"{SOURCE}: pymavlink's common has {', '.join(twice)} already")
    enums = sorted(own.enum, key=lambda each: each.name)
    return "".join((HEAD, *_constants(enums), *_classes(messages)))


def _included(path: Path) -> list[Path]:
    """Return all files that an XML file includes, directly or not."""
    found = []
    waiting = [path]
    while waiting:
        for include in ET.parse(waiting.pop()).getroot().findall("include"):
            file = BUNDLED / (include.text or "")
            if file not in found:
                found.append(file)
                waiting.append(file)
    return sorted(found)


def _constants(enums: Iterable[Any]) -> list[str]:
    """Return the lines of the enums that are not the generator's own, which end each of them."""
    entries = [entry for enum in enums for entry in enum.entry]
    return ["\n"] + [
        f"{entry.name} = {entry.value}\n"
        for entry in entries
        if not entry.name.endswith("_ENUM_END")
    ]


def _classes(messages: list[Any]) -> list[str]:
    """Return the numbers and classes of messages."""
    for message in messages:
        _prepare(message)
    out = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()):  # the generator says what it does
        mavgen_python.generate_classes(out, messages, [])
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    numbers = [f"MAVLINK_MSG_ID_{each.name} = {each.id}\n" for each in messages]
    names = [
        f"    MAVLINK_MSG_ID_{each.name}: MAVLink_{each.name.lower()}_message,\n"
        for each in messages
    ]
    return ["\n", *numbers, "\n".join(lines), "\n\n\nMESSAGES = {\n", *names, "}\n"]


def _prepare(message: Any) -> None:
    """Add to a message what `mavgen_python.generate` adds before it writes the classes."""
    ordered, names = message.ordered_fields, message.fieldnames
    message.fmtstr = "<" + "".join(mavgen_python.mavfmt(field) for field in ordered)
    message.native_fmtstr = "<" + "".join(mavgen_python.native_mavfmt(field) for field in ordered)
    message.fielddefaults = [mavgen_python.mavdefault(field) for field in ordered]
    message.instance_field = next((field.name for field in ordered if field.instance), None)
    message.order_map = [message.ordered_fieldnames.index(name) for name in names]
    message.array_len_map = [field.array_length for field in ordered]
    message.len_map = [0] * len(names)
    for place, position in enumerate(message.order_map):
        message.len_map[position] = message.fieldlengths[place]


def main() -> None:
    """Write the module."""
    TARGET.write_text(written(), encoding="utf-8")
    print(TARGET)


if __name__ == "__main__":
    main()
