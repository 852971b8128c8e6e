"""Virtual CAN interfaces by netlink, as `ip link` makes them, where there may be no `ip`."""

from __future__ import annotations

import fcntl
import os
import socket
import struct

_IFF_UP = 1
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _SIOCSIFMTU = 0x8913, 0x8914, 0x8922
_RTM_NEWLINK, _RTM_DELLINK = 16, 17
_NLM_F_REQUEST, _NLM_F_ACK, _NLM_F_EXCL, _NLM_F_CREATE = 0x1, 0x4, 0x200, 0x400
_IFLA_IFNAME, _IFLA_LINKINFO, _IFLA_INFO_KIND = 3, 18, 1
_IFINFOMSG = struct.Struct("=BxHiII")


def add_vcan(name: str) -> None:
    """Make a virtual CAN interface, as `ip link add dev NAME type vcan`.

    Raises
    ------
    OSError
        If the kernel refuses.
    """
    info = _attribute(_IFLA_INFO_KIND, b"vcan\0")
    body = _name(name) + _attribute(_IFLA_LINKINFO, info)
    _ask(_RTM_NEWLINK, _NLM_F_EXCL | _NLM_F_CREATE, body, f"adding {name}")


def delete(name: str) -> None:
    """Remove an interface, as `ip link del NAME`; raises OSError if the kernel refuses."""
    _ask(_RTM_DELLINK, 0, _name(name), f"deleting {name}")


def set_link(name: str, *, up: bool) -> None:
    """Bring an interface up or down, as `ip link set NAME up`; raises OSError if refused."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sH14x", name.encode(), 0)
        (flags,) = struct.unpack_from("H", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request), 16)
        flags = flags | _IFF_UP if up else flags & ~_IFF_UP
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sH14x", name.encode(), flags))


def set_mtu(name: str, mtu: int) -> None:
    """Set the size of a frame [byte], as `ip link set NAME mtu MTU`: 16, or 72 for CAN FD.

    Raises OSError if the kernel refuses, as it does while the interface is up.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, _SIOCSIFMTU, struct.pack("16si20x", name.encode(), mtu))


def _attribute(kind: int, payload: bytes) -> bytes:
    """Return a netlink attribute, padded to four bytes."""
    length = 4 + len(payload)
    return struct.pack("=HH", length, kind) + payload + bytes(-length % 4)


def _name(name: str) -> bytes:
    """Return the beginning of a message about the interface of that name."""
    return _IFINFOMSG.pack(0, 0, 0, 0, 0) + _attribute(_IFLA_IFNAME, name.encode() + b"\0")


def _ask(kind: int, flags: int, body: bytes, what: str) -> None:
    """Send one request of rtnetlink and wait for its acknowledgement."""
    flags |= _NLM_F_REQUEST | _NLM_F_ACK
    header = struct.pack("=IHHII", 16 + len(body), kind, flags, 1, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0) as netlink:
        netlink.send(header + body)
        (error,) = struct.unpack_from("=i", netlink.recv(4096), 16)
    if error:
        raise OSError(-error, f"{what}: {os.strerror(-error)}")
