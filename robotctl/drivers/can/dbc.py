"""The DBC, read once at start with cantools into plain values; nothing here is on the hot path.

What the codec cannot handle is a `ConfigError` that names it: multiplexed signals, floats of other
than 32 or 64 bits, and end-to-end protection of other than eight bytes.
"""

from __future__ import annotations

import difflib
import struct
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

from robotctl.errors import ConfigError
from robotctl.messages.ports import EXTENDED_FLAG, FD_FLAG, FD_LENGTHS

HOST = "HOST"
"""Name of the robot computer among the DBC's nodes."""

_FLOAT_MAX = {32: struct.unpack("<f", b"\xff\xff\x7f\x7f")[0], 64: sys.float_info.max}
"""Greatest finite float by its length [bit]."""


def urgency(arbitration_id: int) -> int:
    """Return the rank of an identifier, with its flags, in arbitration: the lowest wins.

    Of the same first eleven bits, 11-bit identifiers win.
    """
    if arbitration_id & EXTENDED_FLAG:
        plain = arbitration_id & 0x1FFF_FFFF
        return plain >> 18 << 19 | 1 << 18 | plain & 0x3_FFFF
    return (arbitration_id & 0x7FF) << 19


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal: physical = raw * scale + offset, in `unit`.

    `start` is the DBC's: the lowest bit of a little-endian signal, the highest of a big-endian one.
    `raw_minimum` and `raw_maximum` bound the raw values that the DBC's range [min|max] and the
    field's width allow; `values` names some raw values. A float's raw value is that float.
    """

    name: str
    start: int
    length: int
    big_endian: bool
    signed: bool
    is_float: bool
    scale: float
    offset: float
    raw_minimum: float
    raw_maximum: float
    unit: str
    values: Mapping[int, str]

    def value(self, name: str) -> int:
        """Return the raw value called `name` in the value table; `KeyError` if there is none."""
        for raw, text in self.values.items():
            if text == name:
                return raw
        raise KeyError(name)


@dataclass(frozen=True, slots=True)
class Protection:
    """End-to-end protection of a message, from the attributes `E2E_*`."""

    data_id: int
    counter: str
    crc: str
    max_delta: int


@dataclass(frozen=True, slots=True)
class Message:
    """One frame of the DBC.

    `arbitration_id` has the flags of `Frame` for 29 bits and CAN FD. `cycle_ms` is 0 for events;
    `send_type` is GenMsgSendType.
    """

    name: str
    arbitration_id: int
    length: int
    senders: tuple[str, ...]
    receivers: frozenset[str]
    cycle_ms: int
    send_type: str
    protection: Protection | None
    signals: Mapping[str, Signal]


@dataclass(frozen=True, slots=True)
class Dbc:
    """All messages of one DBC file.

    `wire_version` is the CRC-32 of the file's bytes, which the nodes report as object 0x2001.
    """

    path: str
    wire_version: int
    bitrate: int
    messages: Mapping[str, Message]

    def message(self, name: str) -> Message:
        """Return the message called `name`.

        Raises
        ------
        ConfigError
            If the file has none; names the nearest.
        """
        message = self.messages.get(name)
        if message is None:
            raise ConfigError(
                f"{self.path}: message {name} is missing{_nearest(name, self.messages)}"
            )
        return message

    def signal(self, message: str, name: str) -> Signal:
        """Return the signal `name` of a message; `ConfigError` as `message`."""
        signals = self.message(message).signals
        signal = signals.get(name)
        if signal is None:
            raise ConfigError(
                f"{self.path}: {message}: signal {name} is missing{_nearest(name, signals)}"
            )
        return signal

    def value(self, message: str, signal: str, name: str) -> int:
        """Return the raw value that the value table of a signal calls `name`; as `message`."""
        found = self.signal(message, signal)
        try:
            return found.value(name)
        except KeyError:
            raise ConfigError(
                f"{self.path}: {message}.{signal}: value {name} is missing"
                f"{_nearest(name, found.values.values())}"
            ) from None

    def expect_values(self, message: str, signal: str, kind: type[IntEnum]) -> None:
        """Check that a value table equals an enumeration; `ConfigError` as `message`."""
        for member in kind:
            raw = self.value(message, signal, member.name.lower())
            if raw != member.value:
                raise ConfigError(
                    f"{self.path}: {message}.{signal}: {member.name.lower()} is {raw}, "
                    f"must be {member.value}"
                )

    def protection(self, message: str) -> Protection:
        """Return the protection of a message that must have one; `ConfigError` as `message`."""
        protection = self.message(message).protection
        if protection is None:
            raise ConfigError(f"{self.path}: {message}: attribute E2E_DataId is missing")
        return protection

    def received_by(self, node: str) -> tuple[int, ...]:
        """Return the identifiers of all messages with a signal for `node`, most urgent first."""
        ids = (m.arbitration_id for m in self.messages.values() if node in m.receivers)
        return tuple(sorted(ids, key=urgency))


def load_dbc(path: Path) -> Dbc:
    """Read a DBC file.

    Raises
    ------
    ConfigError
        One line for each error: `FILE: MESSAGE: what is wrong; did you mean "..."?`
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    return _dbc(path, content)


@cache  # for processes that run many robots
def _dbc(path: Path, content: bytes) -> Dbc:
    # The recorder needs this module, but no DBC.
    import cantools.database  # noqa: PLC0415 - it takes 0.1 s
    from cantools.database.errors import Error as CantoolsError  # noqa: PLC0415

    try:
        database: Any = cantools.database.load_string(
            content.decode("cp1252"), database_format="dbc"
        )
    except (CantoolsError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not a valid DBC: {error}") from error
    problems = [f"{path}: {p}" for m in database.messages for p in _message_problems(m)]
    if problems:
        raise ConfigError("\n".join(problems))
    messages = {found.name: _message(found) for found in database.messages}
    bitrate = database.dbc.attributes.get("Baudrate")
    return Dbc(
        str(path),
        zlib.crc32(content),
        int(bitrate.value) if bitrate is not None else 1_000_000,
        messages,
    )


def _message_problems(found: Any) -> Iterator[str]:
    """Yield the properties of a cantools message that codec or E2E protection do not support."""
    name = found.name
    if not found.is_fd and found.length > 8:
        yield f"{name}: has {found.length} bytes, a classic frame at most 8; see VFrameFormat"
    if found.is_fd and found.length not in FD_LENGTHS:
        lengths = ", ".join(map(str, FD_LENGTHS[9:]))
        yield f"{name}: has {found.length} bytes, CAN FD allows 0 to 8, {lengths}"
    for signal in found.signals:
        if signal.is_float and signal.length not in _FLOAT_MAX:
            yield f"{name}.{signal.name}: is a float of {signal.length} bits, must have 32 or 64"
        if signal.multiplexer_ids:  # a multiplexor on which nothing depends is a signal like others
            yield f"{name}.{signal.name}: is multiplexed, which is not supported"
    yield from _protection_problems(found)


def _protection_problems(found: Any) -> Iterator[str]:
    """Yield errors in the E2E attributes of a message."""
    attributes = found.dbc.attributes
    given = [key for key in _E2E_ATTRIBUTES if key in attributes]
    if not given:
        return
    name = found.name
    for key in _E2E_ATTRIBUTES:
        if key not in attributes:
            yield f"{name}: attribute {key} is missing beside {given[0]}"
    if len(given) < len(_E2E_ATTRIBUTES):
        return
    yield from _place_problems(found)
    if found.length != 8 or found.is_fd:
        kind = " of CAN FD" if found.is_fd else ""
        yield f"{name}: is protected and has {found.length} bytes{kind}, must have 8 of classic CAN"
    if not 1 <= attributes["E2E_MaxDeltaCounter"].value <= 13:
        yield f"{name}: E2E_MaxDeltaCounter must be 1 to 13"


def _place_problems(found: Any) -> Iterator[str]:
    """Yield errors in CRC and counter of a protected message."""
    name, attributes = found.name, found.dbc.attributes
    signals = {signal.name: signal for signal in found.signals}
    for key, place in (("E2E_CrcSignal", (0, 8)), ("E2E_CounterSignal", (8, 4))):
        wanted = attributes[key].value
        signal = signals.get(wanted)
        if signal is None:
            yield f"{name}: {key} {wanted}: no such signal{_nearest(wanted, signals)}"
        elif signal.byte_order != "little_endian" or signal.is_float:
            yield f"{name}.{wanted}: is big-endian or a float, profile 1 has neither"
        elif (signal.start, signal.length) != place:
            yield (
                f"{name}.{wanted}: is at bit {signal.start} with {signal.length} bits, "
                f"profile 1 has it at bit {place[0]} with {place[1]}"
            )


_E2E_ATTRIBUTES = ("E2E_DataId", "E2E_CounterSignal", "E2E_CrcSignal", "E2E_MaxDeltaCounter")


def _message(found: Any) -> Message:
    """Turn a message of cantools, free of problems, into ours."""
    attributes = found.dbc.attributes
    protection = None
    if "E2E_DataId" in attributes:
        data_id, counter, crc, max_delta = (attributes[key].value for key in _E2E_ATTRIBUTES)
        protection = Protection(int(data_id), str(counter), str(crc), int(max_delta))
    return Message(
        name=found.name,
        arbitration_id=found.frame_id
        | (EXTENDED_FLAG if found.is_extended_frame else 0)
        | (FD_FLAG if found.is_fd else 0),
        length=found.length,
        senders=tuple(found.senders),
        receivers=frozenset(found.receivers),
        cycle_ms=found.cycle_time or 0,
        send_type=str(found.send_type or "Event"),
        protection=protection,
        signals={signal.name: _signal(signal) for signal in found.signals},
    )


def _signal(found: Any) -> Signal:
    """Turn a signal of cantools into ours. A range [0|0] means none, as DBC editors write it."""
    length: int = found.length
    low: float
    high: float
    if found.is_float:
        low, high = -_FLOAT_MAX[length], _FLOAT_MAX[length]
    else:
        low = -(1 << length - 1) if found.is_signed else 0
        high = (1 << length - 1) - 1 if found.is_signed else (1 << length) - 1
    if found.minimum is not None and found.maximum is not None and found.minimum < found.maximum:
        ends = [(limit - found.offset) / found.scale for limit in (found.minimum, found.maximum)]
        if not found.is_float:
            ends = [round(end) for end in ends]
        low, high = max(low, min(ends)), min(high, max(ends))
    return Signal(
        name=found.name,
        start=found.start,
        length=length,
        big_endian=found.byte_order == "big_endian",
        signed=found.is_signed,
        is_float=found.is_float,
        scale=found.scale,
        offset=found.offset,
        raw_minimum=low,
        raw_maximum=high,
        unit=found.unit or "",
        values={int(raw): str(text) for raw, text in (found.choices or {}).items()},
    )


def _nearest(word: str, allowed: Iterable[str]) -> str:
    """Return `; did you mean "..."?` where one of `allowed` is like `word`."""
    match = difflib.get_close_matches(word, list(allowed), n=1, cutoff=0.5)
    return f'; did you mean "{match[0]}"?' if match else ""
