"""Process 1 of the guest of `tools/vcan-guest`: mounts, vcan0, the command, power off.

Needs nothing but Python: no mount, no ip, no init system.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import json
import os
import signal
import socket
import struct
import sys
import termios
import threading
import traceback
import tty
from pathlib import Path
from typing import Any

COMMAND_NOT_FOUND = 127
NOT_EXECUTABLE = 126
_MOUNTS = (
    ("proc", "/proc", "proc"),
    ("sysfs", "/sys", "sysfs"),
    ("devtmpfs", "/dev", "devtmpfs"),
    ("devpts", "/dev/pts", "devpts"),
    ("tmpfs", "/dev/shm", "tmpfs"),
    ("tmpfs", "/run", "tmpfs"),
)
_LINKS = {"fd": "self/fd", "stdin": "self/fd/0", "stdout": "self/fd/1", "stderr": "self/fd/2"}
# The consoles that the host side connects to its standard output and standard error.
_OUTPUT_CONSOLES = ("/dev/tty1", "/dev/tty2")
_POWER_OFF = 0x4321FEDC
_IFF_UP = 1
_SIOCGIFFLAGS, _SIOCSIFFLAGS = 0x8913, 0x8914
_RTM_NEWLINK = 16
_NLM_F_REQUEST, _NLM_F_ACK, _NLM_F_EXCL, _NLM_F_CREATE = 0x1, 0x4, 0x200, 0x400
_IFLA_IFNAME, _IFLA_LINKINFO, _IFLA_INFO_KIND = 3, 18, 1


def mount_all(libc: ctypes.CDLL) -> None:
    """Give the guest its own kernel interfaces and its own place for sockets."""
    for source, target, kind in _MOUNTS:
        Path(target).mkdir(exist_ok=True)
        if libc.mount(source.encode(), target.encode(), kind.encode(), 0, None) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise OSError(f"mounting {kind} on {target}: {reason}")
    for name, target in _LINKS.items():
        if not Path("/dev", name).exists():
            Path("/dev", name).symlink_to(f"/proc/{target}")


def _attribute(kind: int, payload: bytes) -> bytes:
    """Return a netlink attribute, padded to four bytes."""
    length = 4 + len(payload)
    return struct.pack("=HH", length, kind) + payload + bytes(-length % 4)


def add_vcan(name: str) -> None:
    """Make a virtual CAN interface (rtnetlink RTM_NEWLINK, as `ip link add type vcan`)."""
    info = _attribute(_IFLA_INFO_KIND, b"vcan\0")
    body = struct.pack("=BxHiII", 0, 0, 0, 0, 0)
    body += _attribute(_IFLA_IFNAME, name.encode() + b"\0") + _attribute(_IFLA_LINKINFO, info)
    flags = _NLM_F_REQUEST | _NLM_F_ACK | _NLM_F_EXCL | _NLM_F_CREATE
    header = struct.pack("=IHHII", 16 + len(body), _RTM_NEWLINK, flags, 1, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0) as netlink:
        netlink.send(header + body)
        (error,) = struct.unpack_from("=i", netlink.recv(4096), 16)
    if error:
        raise OSError(-error, f"adding {name}: {os.strerror(-error)}")


def set_up(name: str) -> None:
    """Bring an interface up."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sH14x", name.encode(), 0)
        (flags,) = struct.unpack_from("H", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request), 16)
        request = struct.pack("16sH14x", name.encode(), flags | _IFF_UP)
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, request)


class Output:
    """Carries one output of the command to the host, byte by byte as it is.

    The command writes to a pipe, not to the console itself: a console would be a terminal to it.
    """

    def __init__(self, console: str) -> None:
        self._console = os.open(console, os.O_WRONLY | os.O_NOCTTY)
        tty.setraw(self._console)
        self._pipe, self.command_end = os.pipe()
        self._thread = threading.Thread(target=self._carry, daemon=True)

    def start(self) -> None:
        """Carry from now on; the command has its end of the pipe."""
        os.close(self.command_end)
        self._thread.start()

    def finish(self) -> None:
        """Wait until the host has it all; nobody must be left who could still write."""
        self._thread.join()
        termios.tcdrain(self._console)

    def _carry(self) -> None:
        while chunk := os.read(self._pipe, 65536):
            while chunk:
                chunk = chunk[os.write(self._console, chunk) :]


def start(order: dict[str, Any], stdout: Output, stderr: Output) -> int:
    """Start the command as a child with its own session and return its process id."""
    environment = dict(order["environment"])
    for name in ("runtime", "tmp"):
        Path("/run", name).mkdir(mode=0o700)
    environment |= {"XDG_RUNTIME_DIR": "/run/runtime", "TMPDIR": "/run/tmp"}
    command = order["command"]
    child = os.fork()
    if child:
        return child
    os.setsid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(stdout.command_end, 1)
    os.dup2(stderr.command_end, 2)
    # What Python ignores in this process, the command shall not.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    status = NOT_EXECUTABLE
    try:
        os.chdir(order["directory"])
        os.execvpe(command[0], command, environment)
    except FileNotFoundError as error:
        status = COMMAND_NOT_FOUND
        reason = error.strerror
    except OSError as error:
        reason = error.strerror
    os.write(2, f"vcan-guest: {command[0]}: {reason}\n".encode())
    os._exit(status)


def run(order: dict[str, Any]) -> int:
    """Run the command, bury orphans meanwhile, end what it left behind; return its status."""
    outputs = [Output(console) for console in _OUTPUT_CONSOLES]
    child = start(order, *outputs)
    for output in outputs:
        output.start()
    pid, status = os.wait()
    while pid != child:
        pid, status = os.wait()
    with contextlib.suppress(ProcessLookupError):
        os.kill(-1, signal.SIGKILL)
    for output in outputs:
        output.finish()
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def main() -> None:
    """Do all of it and switch the guest off, whatever happens."""
    folder = Path(sys.argv[1])
    libc = ctypes.CDLL(None, use_errno=True)
    try:
        order = json.loads((folder / "order.json").read_text())
        mount_all(libc)
        set_up("lo")
        add_vcan("vcan0")
        set_up("vcan0")
        status = run(order)
        (folder / "status").write_text(str(status))
    except BaseException:  # noqa: BLE001 - process 1 must reach the power switch
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os.sync()
    libc.reboot(_POWER_OFF)


if __name__ == "__main__":
    main()
