"""Settings of a moteus for a silent host: set and read back over its diagnostic stream.

The time-out itself comes with each command (register 0x027). What the drive does then is
`servo.timeout_mode`, which the host sets for as long as the drive is powered.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Final

from robotctl.drivers.can.drives.moteus import wire
from robotctl.drivers.can.drives.session import Exchange, Script
from robotctl.messages.faults import Fault, FaultCode

REGISTER_MAPS: Final = (5,)
"""Versions of the register map that are known."""

_KEY: Final = "servo.timeout_mode"
_TRIES: Final = 3
_POLLS: Final = 10
"""Polls within which an answer must be whole."""

_MODES: Final = {wire.STOPPED: "coasts", wire.BRAKE: "shorts the motor"}


@dataclass(slots=True)
class MoteusSettings:
    """Scripts of one moteus.

    Parameters
    ----------
    number
        Number of the drive.
    timeout_ms
        Time-out that each command carries [ms].
    timeout_mode
        Wanted mode after it.
    """

    number: int
    timeout_ms: int
    timeout_mode: int
    proof: str | None = None
    """Settings read back, in words; None before."""

    def commission(self) -> Script:
        """Identify the drive, set and read back its mode after the time-out."""
        self.proof = None
        name = "read of the firmware version"
        read = Exchange(
            ((wire.command_id(self.number), wire.pack_read_versions()),),
            name,
            wire.VERSIONS_ANSWER,
        )
        versions = wire.unpack_versions((yield read) or b"")
        if versions is None:
            return read.unanswered()
        firmware, register_map = versions
        if register_map not in REGISTER_MAPS:
            allowed = " or ".join(map(str, REGISTER_MAPS))
            text = (
                f"register map {register_map} of firmware 0x{firmware:06x} is not known, allowed "
                f"is {allowed}"
            )
            return Fault(FaultCode.NODE_OTHER_FIRMWARE, text)
        found = yield from self._ask(f"conf get {_KEY}")
        if found is None:
            return _no_answer()
        if found != str(self.timeout_mode):
            done = yield from self._ask(f"conf set {_KEY} {self.timeout_mode}")
            if done is None:
                return _no_answer()
            found = yield from self._ask(f"conf get {_KEY}")
            if found is None:
                return _no_answer()
        if found != str(self.timeout_mode):
            text = f"{_KEY} reads back {found}, wanted {self.timeout_mode}"
            return Fault(FaultCode.NODE_OTHER_VALUE, text)
        after = _MODES[self.timeout_mode]
        self.proof = f"time-out {self.timeout_ms} ms with each command, then it {after}"
        return None

    def watch(self) -> Script:
        """Read the setting again; one that differs twice was changed."""
        for _ in range(2):
            found = yield from self._ask(f"conf get {_KEY}")
            if found is None:
                return _no_answer()
            if found == str(self.timeout_mode):
                return None
        text = f"{_KEY} reads {found}, wanted {self.timeout_mode}: it was changed"
        return Fault(FaultCode.NODE_CHANGED, text)

    def _ask(self, text: str) -> Generator[Exchange, bytes | None, str | None]:
        """Give the diagnostic stream a line and return the one that answers it, or None."""
        poll = wire.command_id(self.number), wire.pack_poll()
        write = wire.command_id(self.number, answered=False), wire.pack_text(text)
        prefix = bytes((wire.STREAM_ANSWER,))
        for _ in range(_TRIES):
            # What is left of an answer before must not be taken for this one.
            for _ in range(_POLLS):
                rest = yield Exchange((poll,), text, prefix)
                if not wire.unpack_text(rest or b""):
                    break
            said = b""
            answer = yield Exchange((write, poll), text, prefix, attempts=1)
            for _ in range(_POLLS):
                if answer is None:
                    break
                said += wire.unpack_text(answer) or b""
                if said.endswith(b"\n"):
                    return said.decode("ascii", "replace").strip()
                answer = yield Exchange((poll,), text, prefix, attempts=1)
        return None


def _no_answer() -> Fault:
    return Fault(FaultCode.NODE_NO_ANSWER, f"no answer to the read or write of {_KEY}")
