"""Commissioning of an ODrive: its firmware, its watchdog, and whether that stays as it was written.

Firmware 0.6 answers Get_Version, which 0.5 does not know. 0.5 has no access to settings over CAN;
0.6 has (RxSdo, TxSdo), but the numbers of its settings, the endpoints, differ by firmware and
hardware: ODrive publishes them as `flat_endpoints.json` with each release.
"""

from __future__ import annotations

import struct
from collections.abc import Generator
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

from robotctl.drivers.can.drives.odrive import wire
from robotctl.messages.faults import Fault, FaultCode

ENDPOINTS: Final = {
    # github.com/JesseDarr/odrive_can_tools, data/flat_endpoints.json of an ODrive S1
    ((5, 2, 0), (0, 6, 10)): (213, 214),
}
"""Endpoints of `axis0.config.watchdog_timeout` and `axis0.config.enable_watchdog`, by versions of
hardware and firmware."""

ANSWER_NS: Final = 50_000_000
"""Time for an answer [ns]."""

ATTEMPTS: Final = 4
RETRY_NS: Final = 1_000_000_000
"""Pause between a failed commissioning and the next attempt [ns]."""

READ_BACK_NS: Final = 250_000_000
"""Period of readings of settings in service [ns]."""

_FLOAT = struct.Struct("<f")


class Query(NamedTuple):
    """One frame to send, and what answers it.

    Parameters
    ----------
    name
        What people call it.
    arbitration_id, data
        The frame; `data` of a remote request says how long the answer is.
    command
        Message that answers it.
    endpoint, size
        Setting that TxSdo must be about, and bytes of its value; 0: another message.
    attempts
        How often it is sent before it counts as unanswered.
    """

    name: str
    arbitration_id: int
    data: bytes
    command: int
    endpoint: int = 0
    size: int = 0
    attempts: int = ATTEMPTS


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting that the drive must have: `wanted` as its bytes, and in words."""

    name: str
    endpoint: int
    wanted: bytes

    def reading(self, node_id: int) -> Query:
        """Return the query for its value."""
        return Query(
            f"read of {self.name} (endpoint {self.endpoint})",
            wire.can_id(node_id, wire.RX_SDO),
            wire.sdo_read(self.endpoint),
            wire.TX_SDO,
            self.endpoint,
            len(self.wanted),
        )

    def writing(self, node_id: int) -> Query:
        """Return the frame that writes it.

        Only from firmware 0.6.11 on it is confirmed, so that it is over after one attempt.
        """
        return Query(
            f"write of {self.name} (endpoint {self.endpoint})",
            wire.can_id(node_id, wire.RX_SDO),
            wire.sdo_write(self.endpoint, self.wanted),
            wire.TX_SDO,
            self.endpoint,
            attempts=1,
        )

    def differs(self, found: bytes) -> str:
        """Say that it has another value."""
        return f"{self.name} reads back {_words(found)}, wanted {_words(self.wanted)}"


def _words(value: bytes) -> str:
    """Write a value: four bytes are seconds, one is a flag."""
    if len(value) == 1:
        return "on" if value[0] else "off"
    return f"{_FLOAT.unpack(value)[0]:g} s"


class Commissioned(NamedTuple):
    """A drive that may be put into service.

    Parameters
    ----------
    is_old
        Whether its firmware is 0.5.
    kept
        Settings to read back, in turn.
    proof
        What was found, in words.
    """

    is_old: bool
    kept: tuple[Setting, ...]
    proof: str


Script: TypeAlias = Generator[Query, "bytes | None", "Commissioned | Fault"]
"""A commissioning: yields queries, is sent the answers (None: none came), returns its end."""


def commission(node_id: int, timeout_ms: int, endpoints: tuple[int, int] | None) -> Script:
    """Return the commissioning of a node.

    Parameters
    ----------
    node_id
        Its number.
    timeout_ms
        Time without a command after which it must give no power [ms].
    endpoints
        Those of its watchdog, in place of those in `ENDPOINTS`.
    """
    answer = yield _request(node_id, wire.VERSION, "Get_Version")
    if answer is None:
        if (yield _request(node_id, wire.ENCODER_COUNT, "Get_Encoder_Count")) is None:
            text = "no answer to Get_Version (firmware 0.6) nor to Get_Encoder_Count (firmware 0.5)"
            return Fault(FaultCode.NODE_NO_ANSWER, text)
        why = "firmware 0.5 does not tell it over CAN"
        return Commissioned(True, (), _unread("firmware 0.5", why, timeout_ms))
    version = wire.read_version(answer)
    if version.protocol != wire.PROTOCOL_VERSION or version.firmware[:2] != (0, 6):
        text = f"{version}, protocol {version.protocol}: only 0.6 with protocol 2, and 0.5, are"
        return Fault(FaultCode.NODE_OTHER_FIRMWARE, f"{text} supported")
    if endpoints is None and not version.unreleased:
        endpoints = ENDPOINTS.get((version.hardware, version.firmware))
    if endpoints is None:
        why = "its endpoints are not known; watchdog_endpoints of [[motor]] can name them"
        return Commissioned(False, (), _unread(str(version), why, timeout_ms))
    return (yield from _write(node_id, version, _settings(endpoints, timeout_ms)))


def _settings(endpoints: tuple[int, int], timeout_ms: int) -> tuple[Setting, ...]:
    """Return what is written, in this order: a watchdog without a time expires at once."""
    timeout, enable = endpoints
    return (
        Setting("axis0.config.watchdog_timeout", timeout, _FLOAT.pack(timeout_ms / 1000)),
        Setting("axis0.config.enable_watchdog", enable, b"\1"),
    )


def _write(node_id: int, version: wire.Version, settings: tuple[Setting, ...]) -> Script:
    """Write settings and read them back."""
    for setting in settings:
        yield setting.writing(node_id)
        query = setting.reading(node_id)
        found = yield query
        if found is None:
            return no_answer(query)
        if found != setting.wanted:
            return Fault(FaultCode.NODE_OTHER_VALUE, setting.differs(found))
    values = ", ".join(f"{setting.name} {_words(setting.wanted)}" for setting in settings)
    return Commissioned(False, settings, f"{version}: {values}, read back")


def _request(node_id: int, command: int, name: str) -> Query:
    """Return the remote request for a message."""
    return Query(name, wire.request_id(node_id, command), bytes(8), command)


def _unread(version: str, why: str, timeout_ms: int) -> str:
    """Say of a drive that its watchdog is not known, and so what the proof of it must show."""
    return (
        f"{version}: the watchdog cannot be read ({why}); set with odrivetool, to give no power "
        f"{timeout_ms} ms after the last command"
    )


def no_answer(query: Query) -> Fault:
    """Say that nothing came back."""
    return Fault(FaultCode.NODE_NO_ANSWER, f"no answer to {query.name}")


class Commissioning:
    """Carries out a script, and one reading at a time after it; does no I/O.

    Attributes
    ----------
    end
        Of the script; None while it runs.
    """

    def __init__(self, script: Script) -> None:
        self.end: Commissioned | Fault | None = None
        self._script = script
        self._query: Query | None = next(script)
        self._attempts = 0
        self._sent_ns = 0
        self._is_reading = False
        self._answer: bytes | None = None
        """Answer to a reading."""

    @property
    def waiting(self) -> bool:
        """Whether a query is not yet answered."""
        return self._query is not None

    def read(self, query: Query) -> None:
        """Begin a reading beside the script, which is over."""
        self._query, self._attempts, self._is_reading = query, 0, True

    def cancel(self) -> None:
        """Forget what is under way; a late answer will be ignored."""
        self._query = None

    def poll(self, now_ns: int) -> tuple[int, bytes] | None:
        """Return the frame to send now, if any; `sent` says that the bus took it."""
        query = self._query
        if query is None or (self._attempts and now_ns - self._sent_ns < ANSWER_NS):
            return None
        return query.arbitration_id, query.data

    def sent(self, now_ns: int) -> None:
        """Note that the frame of `poll` was sent."""
        self._sent_ns = now_ns
        self._attempts += 1

    def expire(self, now_ns: int) -> Query | None:
        """Give up a query after its attempts; return a reading that was given up."""
        query = self._query
        if query is None or self._attempts < query.attempts or now_ns - self._sent_ns < ANSWER_NS:
            return None
        self._query = None
        if self._is_reading:
            return query
        self._advance(None)
        return None

    def take(self, command: int, data: bytes) -> bytes | None:
        """Take a message of the node; return the value of a reading if it is that."""
        query = self._query
        if query is None or not self._attempts or query.command != command:
            return None
        answer: bytes | None = data
        if query.endpoint:
            answer = wire.sdo_value(data, query.endpoint, query.size)
        elif len(data) != 8:
            return None
        if answer is None:
            return None
        self._query = None
        if self._is_reading:
            return answer
        self._advance(answer)
        return None

    def _advance(self, answer: bytes | None) -> None:
        """Pass an answer to the script."""
        self._attempts = 0
        try:
            self._query = self._script.send(answer)
        except StopIteration as stop:
            self.end = stop.value
