"""Settings of a VESC that decide what happens when the host dies: read, set, kept under watch.

They are at the beginning of its app configuration (`confgenerator.c` of vedderb/bldc), which the
host can read as a whole and write back as a whole, for as long as the drive is powered. The
layout up to the brake current is that of all firmware from 3 to 6; of the rest the host changes
nothing.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from robotctl.drivers.can.drives.session import PAUSE, Exchange, Script
from robotctl.drivers.can.drives.vesc.wire import (
    COMM_FW_VERSION,
    COMM_GET_APPCONF,
    COMM_SET_APPCONF_NO_STORE,
    to_frames,
)
from robotctl.messages.faults import Fault, FaultCode

MAJORS: Final = (5, 6)
"""Major versions of the firmware whose packets are known."""

SUPERVISION_MS: Final = 10
"""Period in which the firmware looks whether its time-out has passed [ms] (`timeout.c`)."""

_HEAD = struct.Struct(">BIBIf")
"""Packet, signature, number, time-out [ms], brake current [A]."""

_SERVO_OUTPUT: Final = 32
"""Place of `servo_out_enable` in the packet of firmware 6."""

_STATUS_PAUSES: Final = 5
"""Pauses within which all wanted status messages must have come."""


class Silence(NamedTuple):
    """Reaction to a silent host: time-out [ms] and brake current then [A]."""

    timeout_ms: int
    brake_current_a: float

    def __str__(self) -> str:
        after = (
            f"brakes with {self.brake_current_a:g} A" if self.brake_current_a > 0.0 else "coasts"
        )
        return f"time-out {self.timeout_ms} ms, then it {after}"


@dataclass(slots=True)
class VescSettings:
    """Scripts of one VESC.

    Parameters
    ----------
    number, reply_to
        Number of the VESC, and that to which it answers.
    wanted
        What its settings must be.
    writes
        Whether the host sets them; else they must be found so.
    steers
        Whether its servo output is used.
    missing
        Names the status messages that have not come yet; empty if all have.
    """

    number: int
    reply_to: int
    wanted: Silence
    writes: bool
    steers: bool
    missing: Callable[[], str]
    proof: str | None = None
    """Settings read back, in words; None before."""

    def commission(self) -> Script:
        """Identify the drive, set and read back its settings, see that its status comes."""
        self.proof = None
        name = "read of the firmware version"
        packet = yield self._ask(bytes((COMM_FW_VERSION,)), name)
        if packet is None:
            return _no_answer(name)
        if len(packet) < 3 or packet[1] not in MAJORS:
            allowed = " or ".join(map(str, MAJORS))
            found = f"{packet[1]}.{packet[2]:02}" if len(packet) >= 3 else f"'{packet.hex()}'"
            text = f"firmware {found} is not known, allowed is major version {allowed}"
            return Fault(FaultCode.NODE_OTHER_FIRMWARE, text)
        major = packet[1]
        problem = yield from self._configure()
        if problem is not None:
            return problem
        problem = yield from self._read_servo_output(major) if self.steers else _nothing()
        if problem is not None:
            return problem
        for _ in range(_STATUS_PAUSES):
            if not self.missing():
                self.proof = str(self.wanted)
                return None
            yield PAUSE
        text = (
            f"sends no {self.missing()}: enable it in VESC Tool, App Settings, General, "
            "CAN Status Messages"
        )
        return Fault(FaultCode.NODE_NO_ANSWER, text)

    def watch(self) -> Script:
        """Read the settings again; one that differs twice was changed."""
        for _ in range(2):
            packet = yield self._read()
            if packet is None:
                return _no_answer("read of the app configuration")
            found = self._found(packet)
            if found == self.wanted:
                return None
        text = f"the drive says {_words(found)}, wanted {self.wanted}: it was changed"
        return Fault(FaultCode.NODE_CHANGED, text)

    def _configure(self) -> Script:
        """Read the settings, and write them where they differ and the host may."""
        packet = yield self._read()
        if packet is None:
            return _no_answer("read of the app configuration")
        found = self._found(packet)
        if isinstance(found, str):
            return Fault(FaultCode.NODE_OTHER_DEVICE, f"its app configuration {found}")
        if found == self.wanted:
            return None
        if not self.writes:
            text = f"the drive says {found}, the robot's file accepts {self.wanted}"
            return Fault(FaultCode.NODE_OTHER_VALUE, text)
        _, signature, *_ = _HEAD.unpack_from(packet)
        head = _HEAD.pack(COMM_SET_APPCONF_NO_STORE, signature, self.number, *self.wanted)
        name = "write of the app configuration (time-out)"
        done = yield self._ask(head + packet[_HEAD.size :], name)
        if done is None:
            text = (
                f"no answer to the {name}: firmware without COMM_SET_APPCONF_NO_STORE; set the "
                "time-out in VESC Tool and accept it by accept_timeout_ms"
            )
            return Fault(FaultCode.NODE_NO_ANSWER, text)
        again = yield self._read()
        if again is None:
            return _no_answer("read of the app configuration")
        if self._found(again) != self.wanted or again[_HEAD.size :] != packet[_HEAD.size :]:
            text = f"reads back {_words(self._found(again))}, wanted {self.wanted}"
            return Fault(FaultCode.NODE_OTHER_VALUE, text)
        return None

    def _read_servo_output(self, major: int) -> Script:
        """Check that the servo output is on, where the firmware's layout is known."""
        if major != 6:
            return None
        packet = yield self._read()
        if packet is None:
            return _no_answer("read of the app configuration")
        if len(packet) > _SERVO_OUTPUT and packet[_SERVO_OUTPUT] == 0:
            text = "its servo output is off: VESC Tool, App Settings, General, Enable Servo Output"
            return Fault(FaultCode.NODE_OTHER_VALUE, text)
        return None

    def _found(self, packet: bytes) -> Silence | str:
        """Return the settings in an answer, or in words that it is not to be understood."""
        if len(packet) < _HEAD.size:
            return f"has {len(packet)} bytes, at least {_HEAD.size} are needed"
        _, _, number, timeout_ms, brake_current_a = _HEAD.unpack_from(packet)
        if number != self.number:
            return f"is of a VESC with number {number}"
        return Silence(timeout_ms, brake_current_a)

    def _read(self) -> Exchange:
        return self._ask(bytes((COMM_GET_APPCONF,)), "read of the app configuration")

    def _ask(self, packet: bytes, name: str) -> Exchange:
        return Exchange(to_frames(packet, self.number, self.reply_to), name, packet[:1])


def single(value: float) -> float:
    """Return a number as a float of 32 bits carries it."""
    rounded: float = struct.unpack(">f", struct.pack(">f", value))[0]
    return rounded


def _nothing() -> Script:
    """Script without exchanges."""
    return None
    yield PAUSE


def _no_answer(name: str) -> Fault:
    return Fault(FaultCode.NODE_NO_ANSWER, f"no answer to the {name}")


def _words(found: Silence | str) -> str:
    return found if isinstance(found, str) else str(found)
