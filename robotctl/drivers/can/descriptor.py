"""An open CAN bus and the socket under it, and the layout of the frames that go through.

python-can opens and configures the bus; what needs speed then uses the socket itself.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import socket
import struct
from collections.abc import Callable, Collection
from typing import Final

import can
from can.typechecking import CanFilter

from robotctl.drivers.can.config import FD_MTU, CanConfig
from robotctl.messages.ports import EXTENDED_FLAG, REMOTE_FLAG

CAN_SFF_MASK: Final = 0x7FF
CAN_EFF_MASK: Final = 0x1FFF_FFFF
NODE_NAME: Final = "host"
"""Name of this node in simcan's log and faults."""

FRAME: Final = struct.Struct("=IB3x8s")
"""SocketCAN's `struct can_frame`: identifier with flags, number of bytes, data."""
FD_FRAME: Final = struct.Struct("=IBB2x64s")
"""SocketCAN's `struct canfd_frame`: identifier with flags, number of bytes, flags of FD, data."""
BIT_RATE_SWITCH, ERROR_STATE, FDF = 0x01, 0x02, 0x04
"""Flags of CAN FD: CANFD_BRS, CANFD_ESI and CANFD_FDF of linux/can.h."""

_GET_MTU = 0x8921
"""SIOCGIFMTU of linux/sockios.h."""
_INTERFACE_REQUEST = struct.Struct("16si20x")
"""struct ifreq: name and MTU."""


class Descriptor:
    """An open python-can bus and a non-blocking socket on the same file description.

    Parameters
    ----------
    bus
        An open bus whose `fileno()` is a socket.

    Attributes
    ----------
    kernel
        Whether this is SocketCAN, with kernel time stamps beside each frame.
    waits
        `poll` of the socket: the cheapest answer to whether a frame waits, an error, or the end.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.socket = socket.socket(fileno=os.dup(bus.fileno()))
        self.socket.setblocking(False)
        self.kernel = self.socket.family == socket.AF_CAN
        signal = select.poll()
        signal.register(self.socket, select.POLLIN)
        self.waits = signal.poll

    def close(self) -> None:
        """Release both; a bus that is already gone is no error."""
        self.socket.close()
        try:
            self.bus.shutdown()
        except (OSError, can.CanError):
            return


OpenDescriptor = Callable[[], Descriptor]


def opener(config: CanConfig, arbitration_ids: Collection[int] | None) -> OpenDescriptor:
    """Return the function that opens the bus of `config`, filtered to identifiers if there are any.

    The first call goes through `can.Bus`, which looks the interface up among the installed ones;
    later calls build the same class directly, without that search. A network device that is not
    there, or does not carry the bus's CAN FD, is found out first, since python-can logs each
    failure.
    """
    filters = None if arbitration_ids is None else [_filter(each) for each in arbitration_ids]
    fd = config.data_bitrate > 0
    found: list[type[can.BusABC]] = []

    def open_descriptor() -> Descriptor:
        if config.interface == "socketcan":
            # Raises OSError for a missing device, before python-can logs it.
            socket.if_nametoindex(config.channel)
            if fd and device_mtu(config.channel) < FD_MTU:
                raise OSError(errno.EMSGSIZE, "it carries classic frames only, not CAN FD")
        if found:
            bus = found[0](channel=config.channel, can_filters=filters, fd=fd, node=NODE_NAME)
        else:
            bus = can.Bus(
                interface=config.interface,
                channel=config.channel,
                can_filters=filters,
                fd=fd,
                node=NODE_NAME,
            )
            found.append(type(bus))
        try:
            return Descriptor(bus)
        except OSError:
            bus.shutdown()
            raise

    return open_descriptor


def _filter(arbitration_id: int) -> CanFilter:
    """Return the kernel's filter for an identifier with its flags; it knows no `FD_FLAG`."""
    extended = bool(arbitration_id & EXTENDED_FLAG)
    mask = CAN_EFF_MASK if extended else CAN_SFF_MASK
    can_id = arbitration_id & (mask | REMOTE_FLAG)
    return CanFilter(can_id=can_id, can_mask=mask | REMOTE_FLAG, extended=extended)


def device_mtu(channel: str) -> int:
    """Return how many bytes a frame of a network device has at most: 72 where it knows CAN FD.

    Raises
    ------
    OSError
        If there is no such device.
    """
    request = bytearray(_INTERFACE_REQUEST.pack(os.fsencode(channel), 0))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, _GET_MTU, request)
    return int(_INTERFACE_REQUEST.unpack(request)[1])
