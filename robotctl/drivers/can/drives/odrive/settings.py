"""Commissioning of an ODrive: its firmware, its watchdog, and whether that stays as it was written.

Firmware 0.6 answers Get_Version, which 0.5 does not know. 0.5 has no access to settings over CAN;
0.6 has (RxSdo, TxSdo), but the numbers of its settings, the endpoints, differ by firmware and
hardware: ODrive publishes them as `flat_endpoints.json` with each release.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from robotctl.drivers.can.drives.odrive import wire
from robotctl.drivers.can.drives.odrive.wire import NewCommand, OldCommand
from robotctl.drivers.can.drives.session import Exchange, Script
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
"""Number of times that an exchange is tried."""

READING_NS: Final = 250_000_000
"""Period of reading a setting again in service [ns]."""

_FLOAT = struct.Struct("<f")
_COMMAND_AND_ENDPOINT = struct.Struct("<BH")


@dataclass(frozen=True, slots=True)
class Setting:
    """A setting that the drive must have: `wanted` as its bytes, and in words."""

    name: str
    endpoint: int
    wanted: bytes

    @property
    def prefix(self) -> bytes:
        """Beginning of an answer about it, see `answer_of`."""
        return _COMMAND_AND_ENDPOINT.pack(NewCommand.TX_SDO, self.endpoint)

    def value(self, answer: bytes) -> bytes:
        """Return its value in an answer."""
        start = _COMMAND_AND_ENDPOINT.size
        return answer[start : start + len(self.wanted)]

    def reading(self, node_id: int) -> Exchange:
        """Return the exchange that reads it."""
        return Exchange(
            ((wire.can_id(node_id, NewCommand.RX_SDO), wire.sdo_read(self.endpoint)),),
            f"read of {self.name} (endpoint {self.endpoint})",
            self.prefix,
            ATTEMPTS,
            ANSWER_NS,
            len(self.prefix) + len(self.wanted),
        )

    def writing(self, node_id: int) -> Exchange:
        """Return the exchange that writes it.

        Only from firmware 0.6.11 on it is confirmed, so that it is over after one attempt.
        """
        return Exchange(
            (
                (
                    wire.can_id(node_id, NewCommand.RX_SDO),
                    wire.sdo_write(self.endpoint, self.wanted),
                ),
            ),
            f"write of {self.name} (endpoint {self.endpoint})",
            self.prefix,
            attempts=1,
            answer_ns=ANSWER_NS,
        )

    def differs(self, found: bytes) -> str:
        """Say that it has another value."""
        return f"{self.name} reads back {_words(found)}, wanted {_words(self.wanted)}"


def _words(value: bytes) -> str:
    """Write a value: four bytes are seconds, one is a flag."""
    if len(value) == 1:
        return "on" if value[0] else "off"
    return f"{_FLOAT.unpack(value)[0]:g} s"


def answer_of(command: int, data: bytes) -> bytes:
    """Return a message that only comes as an answer, as `Session.answer` takes it."""
    return bytes((command,)) + (wire.sdo_content(data) if command == NewCommand.TX_SDO else data)


@dataclass(slots=True)
class ODriveSettings:
    """Scripts of one ODrive.

    Parameters
    ----------
    node_id
        Its number.
    timeout_ms
        Time without a command after which it must give no power [ms].
    endpoints
        Those of its watchdog, in place of those in `ENDPOINTS`; or none.
    """

    node_id: int
    timeout_ms: int
    endpoints: tuple[int, ...] = ()
    is_old: bool = False
    """Whether its firmware is 0.5, once it is in service."""
    proof: str = ""
    """Settings found, in words, once it is in service."""
    kept: tuple[Setting, ...] = ()
    """Settings to read back; the first is next."""

    def commission(self) -> Script:
        """Identify the firmware; with 0.6, set and read back the watchdog."""
        self.is_old, self.kept = False, ()
        answer = yield self._request(NewCommand.VERSION, "Get_Version")
        if answer is None:
            if (yield self._request(OldCommand.ENCODER_COUNT, "Get_Encoder_Count")) is None:
                text = "Get_Version (firmware 0.6) nor to Get_Encoder_Count (firmware 0.5)"
                return Fault(FaultCode.NODE_NO_ANSWER, f"no answer to {text}")
            self.is_old = True
            why = "firmware 0.5 does not tell it over CAN"
            self.proof = self._unread("firmware 0.5", why)
            return None
        version = wire.read_version(answer[1:])
        if version.protocol != wire.PROTOCOL_VERSION or version.firmware[:2] != (0, 6):
            text = f"{version}, protocol {version.protocol}: only 0.6 with protocol 2, and 0.5, are"
            return Fault(FaultCode.NODE_OTHER_FIRMWARE, f"{text} supported")
        endpoints = self.endpoints
        if not endpoints and not version.unreleased:
            endpoints = ENDPOINTS.get((version.hardware, version.firmware), ())
        if not endpoints:
            why = "its endpoints are not known; watchdog_endpoints of [[motor]] can name them"
            self.proof = self._unread(str(version), why)
            return None
        return (yield from self._write(version, *endpoints))

    def _write(self, version: wire.Version, timeout: int, enable: int) -> Script:
        """Write the settings and read them back: a watchdog without a time expires at once."""
        settings = (
            Setting("axis0.config.watchdog_timeout", timeout, _FLOAT.pack(self.timeout_ms / 1000)),
            Setting("axis0.config.enable_watchdog", enable, b"\1"),
        )
        for setting in settings:
            yield setting.writing(self.node_id)
            reading = setting.reading(self.node_id)
            answer = yield reading
            if answer is None:
                return reading.unanswered()
            found = setting.value(answer)
            if found != setting.wanted:
                return Fault(FaultCode.NODE_OTHER_VALUE, setting.differs(found))
        values = ", ".join(f"{setting.name} {_words(setting.wanted)}" for setting in settings)
        self.kept, self.proof = settings, f"{version}: {values}, read back"
        return None

    def watch(self) -> Script:
        """Read the next setting again; one that differs twice was changed."""
        if not self.kept:
            return None
        setting, *others = self.kept
        reading = setting.reading(self.node_id)
        for _ in range(2):
            answer = yield reading
            if answer is None:
                return reading.unanswered()
            found = setting.value(answer)
            if found == setting.wanted:
                self.kept = (*others, setting)
                return None
        text = f"{setting.differs(found)}: it was changed, or the drive restarted"
        return Fault(FaultCode.NODE_CHANGED, text)

    def _request(self, command: int, name: str) -> Exchange:
        """Return the remote request for a message of eight bytes."""
        frame = wire.request_id(self.node_id, command), bytes(8)
        return Exchange((frame,), name, bytes((command,)), ATTEMPTS, ANSWER_NS, 9)

    def _unread(self, version: str, why: str) -> str:
        """Say that the watchdog is not known, and so what the proof of it must show."""
        return (
            f"{version}: the watchdog cannot be read ({why}); set with odrivetool, to give no "
            f"power {self.timeout_ms} ms after the last command"
        )
