"""A CAN controller that goes bus-off, by QEMU's debugger.

QEMU's SJA1000 makes no errors. So the debugger answers in its place when the kernel's driver next
reads two registers of can0's controller: the interrupt is an error, the status is bus-off. All that
the driver does about it is real.
"""

from __future__ import annotations

import socket
import struct
from pathlib import Path
from typing import Final

STATUS, INTERRUPT = 2, 3
"""Registers of the SJA1000."""
ANSWERS: Final = {INTERRUPT: 0x04, STATUS: 0xC0}
"""Error warning; bus off, and at least one counter over its limit."""
REGISTERS: Final = {"x86_64": (5, 4, 0, 7, 16), "aarch64": (0, 1, 0, 31, 32)}
"""Numbers of the registers, to a debugger: first and second argument, result, stack, next
instruction."""
LINK: Final = 30
"""Register with the return address on aarch64."""
READS: Final = 400


class Debugger:
    """A connection to QEMU's debugger (GDB's remote protocol); the computer stands meanwhile."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(120.0)
        self._socket.connect(str(path))
        self._waiting = b""
        self.ask("?")

    def ask(self, request: str) -> str:
        """Send a request and return the answer."""
        data = request.encode()
        self._socket.sendall(b"$%s#%02x" % (data, sum(data) % 256))
        while b"#" not in self._waiting[:-2]:
            self._waiting += self._socket.recv(65536)
        answer, _, rest = self._waiting.partition(b"#")
        self._waiting = rest[2:]
        self._socket.sendall(b"+")
        return answer.lstrip(b"+").removeprefix(b"$").decode()

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
    answers = dict(ANSWERS)
    for _ in range(READS):
        debugger.ask("c")
        asked = debugger.register(second) & 0xFF
        device = debugger.number(debugger.register(first))
        if (
            debugger.memory(device, 5) == b"can0\0"
            and asked == (INTERRUPT, STATUS)[INTERRUPT not in answers]
        ):
            debugger.set_register(result, answers.pop(asked))
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
