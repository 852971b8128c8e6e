"""A CAN controller that goes bus-off, by QEMU's debugger.

QEMU's SJA1000 makes no errors and counts none. So the debugger answers in its place when the
kernel's driver reads registers of can0's controller. All that the driver does about it is real.
"""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import Final

from arm_guest_image import GuestError

STATUS, INTERRUPT, RECEIVE_ERRORS, TRANSMIT_ERRORS = 2, 3, 14, 15
"""Registers of the SJA1000."""
ANSWERS: Final = (
    (INTERRUPT, 0x04), (STATUS, 0x40), (TRANSMIT_ERRORS, 96), (RECEIVE_ERRORS, 0),
    (INTERRUPT, 0x20), (STATUS, 0x40), (TRANSMIT_ERRORS, 128), (RECEIVE_ERRORS, 0),
    (INTERRUPT, 0x04), (STATUS, 0xC0), (TRANSMIT_ERRORS, 127), (RECEIVE_ERRORS, 0),
)  # fmt: skip
"""What it says, in the order in which the driver asks: error warning, error passive, bus-off."""
REGISTERS: Final = {"x86_64": (5, 4, 0, 7, 16), "aarch64": (0, 1, 0, 31, 32)}
"""Numbers of the registers, to a debugger: first and second argument, result, stack, next
instruction."""
LINK: Final = 30
"""Register with the return address on aarch64."""
READS: Final = 400
"""More reads are not looked at."""


class Debugger:
    """A connection to QEMU's debugger (GDB's remote protocol); the computer stands meanwhile."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(120.0)
        self._socket.connect(str(path))
        self._waiting = b""
        self.ask("?")
        self.ask("qXfer:features:read:target.xml:0,ffb")  # else it does not tell single registers

    def ask(self, request: str) -> str:
        """Send a request and return the answer."""
        data = request.encode()
        self._socket.sendall(b"$%s#%02x" % (data, sum(data) % 256))
        answer = "T"
        while answer.startswith("T"):
            while b"#" not in self._waiting[:-2]:
                self._waiting += self._socket.recv(65536)
            packet, _, rest = self._waiting.partition(b"#")
            self._waiting = rest[2:]
            self._socket.sendall(b"+")
            answer = packet.lstrip(b"+").removeprefix(b"$").decode()
            if request in ("?", "c", "s"):
                break  # else it tells once more that the computer stands
        return answer

    def memory(self, address: int, length: int) -> bytes:
        """Return some bytes of memory."""
        return bytes.fromhex(self.ask(f"m{address:x},{length:x}"))

    def number(self, address: int) -> int:
        """Return eight bytes of memory as a number."""
        return int(struct.unpack("<Q", self.memory(address, 8))[0])

    def register(self, number: int) -> int:
        """Return a register."""
        return int.from_bytes(bytes.fromhex(self.ask(f"p{number:x}")), "little")

    def set_register(self, number: int, value: int) -> None:
        """Write a register."""
        self.ask(f"P{number:x}={struct.pack('<Q', value).hex()}")

    def go_on(self) -> None:
        """Let the computer go on."""
        self.ask("D")
        self._socket.close()


def fail_controller(path: Path, machine: str, reads_register: int) -> None:
    """Let can0's controller say that it is bus-off, to the driver's function `reads_register`."""
    first, second, result, stack, following = REGISTERS[machine]
    debugger = Debugger(path)
    stop = f"0,{reads_register:x},{1 if machine == 'x86_64' else 4}"
    debugger.ask(f"Z{stop}")
    answers = list(ANSWERS)
    for _ in range(READS):
        debugger.ask("c")
        asked = debugger.register(second) & 0xFF
        device = debugger.number(debugger.register(first))
        if asked == answers[0][0] and debugger.memory(device, 5) == b"can0\0":
            debugger.set_register(result, answers.pop(0)[1])
            if machine == "x86_64":
                top = debugger.register(stack)
                debugger.set_register(following, debugger.number(top))
                debugger.set_register(stack, top + 8)
            else:
                debugger.set_register(following, debugger.register(LINK))
            if not answers:
                break
        else:
            debugger.ask(f"z{stop}")
            debugger.ask("s")
            debugger.ask(f"Z{stop}")
    debugger.ask(f"z{stop}")
    debugger.go_on()
    if answers:
        raise GuestError("the driver of can0 did not ask its controller")
