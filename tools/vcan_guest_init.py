"""Process 1 of the guest of `tools/vcan-guest`: mounts, vcan0, the command, power off.

Needs nothing but Python: no mount, no ip, no init system.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import socket
import struct
import sys
import termios
import traceback
from pathlib import Path

COMMAND_NOT_FOUND = 127
_MOUNTS = (
    ("proc", "/proc", "proc"),
    ("sysfs", "/sys", "sysfs"),
    ("devtmpfs", "/dev", "devtmpfs"),
    ("devpts", "/dev/pts", "devpts"),
    ("tmpfs", "/dev/shm", "tmpfs"),
    ("tmpfs", "/run", "tmpfs"),
)
_LINKS = (("fd", "self/fd"), ("stdin", "self/fd/0"), ("stdout", "self/fd/1"), ("stderr", "self/fd/2"))
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
    for name, target in _LINKS:
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


def plain_output() -> None:
    """Let the console pass bytes as they are, without carriage returns."""
    attributes = termios.tcgetattr(1)
    attributes[1] &= ~termios.OPOST
    termios.tcsetattr(1, termios.TCSANOW, attributes)


def run(order: dict[str, object]) -> int:
    """Run the command as a child, adopt and bury orphans, and return its status."""
    environment = dict(order["environment"])  # type: ignore[call-overload]
    for name in ("runtime", "tmp"):
        Path("/run", name).mkdir(mode=0o700)
    environment |= {"XDG_RUNTIME_DIR": "/run/runtime", "TMPDIR": "/run/tmp"}
    command = [str(part) for part in order["command"]]  # type: ignore[attr-defined]
    child = os.fork()
    if child == 0:
        os.setsid()
        try:
            os.chdir(str(order["directory"]))
            os.execvpe(command[0], command, environment)
        except OSError as error:
            print(f"vcan-guest: {command[0]}: {error.strerror}", file=sys.stderr, flush=True)
            os._exit(COMMAND_NOT_FOUND)
    while True:
        pid, status = os.wait()
        if pid == child:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else 128 - code


def main() -> None:
    """Do all of it and switch the guest off, whatever happens."""
    folder = Path(sys.argv[1])
    libc = ctypes.CDLL(None, use_errno=True)
    try:
        order = json.loads((folder / "order.json").read_text())
        mount_all(libc)
        plain_output()
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
