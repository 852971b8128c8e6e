"""Couples a simulated bus to a SocketCAN interface, as a node of the bus.

Frames which host programs send on the interface (`vcan0`) enter the bus at the time they are read
and compete there; frames of the simulated nodes leave on the interface when they are complete.
Error messages of the bridge's controller leave there, too. Nothing goes round in circles: a raw
socket does not get its own frames back (CAN_RAW_RECV_OWN_MSGS is off, the kernel's default), and
the bus does not give a port its own frames.

Host programs see one difference from a real interface: among themselves they see a frame when it is
sent, before it has passed the bus.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import select
import socket
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_sim.bus import wire
from firmware_sim.bus.errors import ErrorState
from firmware_sim.bus.frame import ERROR_FLAG, Frame

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus

_READS_PER_SERVICE = 64
_RECEIVE_BUFFER = 1 << 20
_REOPEN_NS = 100_000_000
_GET_MTU = 0x8921
"""SIOCGIFMTU of linux/sockios.h."""
_INTERFACE_REQUEST = struct.Struct("16si20x")
"""struct ifreq: name and MTU."""


class Bridge:
    """A raw CAN socket on one side, a port of the bus on the other.

    Parameters
    ----------
    bus
        The bus.
    connection
        A bound raw CAN socket, or anything which passes `can_frame`s, and on a bus of CAN FD
        `canfd_frame`s, as datagrams. The bridge closes it.
    name
        Name of the node.
    restart_ms, queue_limit
        As for `Bus.attach`.
    reopen
        Opens the interface again after it was taken away, every 100 ms until it is back; None:
        never.

    Attributes
    ----------
    lost
        Frames which the interface did not take.
    dropped
        Frames of the host that the bus refused, or that were malformed.
    problem
        The interface's last error; None: no error.
    """

    def __init__(
        self,
        bus: Bus,
        connection: socket.socket,
        name: str = "bridge",
        *,
        restart_ms: int | None = 100,
        queue_limit: int = 64,
        reopen: Callable[[], socket.socket] | None = None,
    ) -> None:
        self.lost = 0
        self.dropped = 0
        self.problem: OSError | None = None
        self._socket = connection
        self._socket.setblocking(False)
        self._reopen = reopen
        self._reopen_ns: int | None = None
        self._paused = False
        self.port = bus.attach(
            name, self._receive, errors=True, restart_ms=restart_ms, queue_limit=queue_limit
        )
        self._epoll = select.epoll()
        self._epoll.register(connection.fileno(), select.EPOLLIN)

    @classmethod
    def open(cls, bus: Bus, interface: str, *, restart_ms: int | None = 100) -> Bridge:
        """Bridge the bus to a SocketCAN interface, as "bridge:INTERFACE".

        Raises
        ------
        OSError
            If the kernel has no CAN, there is no such interface, or it does not carry the bus's
            CAN FD; the message names it.
        """

        def connect() -> socket.socket:
            return _connect(interface, fd=bus.data_bitrate > 0)

        name = f"bridge:{interface}"
        return cls(bus, connect(), name, restart_ms=restart_ms, reopen=connect)

    def fileno(self) -> int:
        """Return the descriptor that is readable when `service` has something to do."""
        return self._epoll.fileno()

    def service(self, now_ns: int) -> None:
        """Send the host's frames at the bus's present time; never waits.

        `now_ns` is CLOCK_MONOTONIC [ns].

        To be called when `fileno` is readable, and now and then besides.
        """
        port = self.port
        if self._reopen_ns is not None and now_ns >= self._reopen_ns:
            self._try_to_reopen(now_ns)
        for _ in range(_READS_PER_SERVICE):
            self._pause(paused=not port.room and port.state is not ErrorState.BUS_OFF)
            if self._paused:
                return
            try:
                message = self._socket.recv(128)
            except BlockingIOError:
                return
            except OSError as error:  # the interface went down or away
                self._fail(error, now_ns)
                return
            if not self._pass_on(message):
                self.dropped += 1

    def _fail(self, error: OSError, now_ns: int) -> None:
        """Remember the error; a socket does not recover when its interface returns."""
        self.problem = error
        if self._reopen is not None and self._reopen_ns is None:
            self._reopen_ns = now_ns

    def _try_to_reopen(self, now_ns: int) -> None:
        """Replace the socket of an interface that went down or was removed."""
        if self._reopen is None:
            return
        try:
            connection = self._reopen()
        except OSError as error:
            self.problem = error
            self._reopen_ns = now_ns + _REOPEN_NS
            return
        connection.setblocking(False)
        self._epoll.unregister(self._socket.fileno())
        self._socket.close()
        self._socket, self._paused, self._reopen_ns = connection, False, None
        self._epoll.register(connection.fileno(), select.EPOLLIN)

    def _pass_on(self, message: bytes) -> bool:
        try:
            arbitration_id, data = wire.unpack_frame(message)
            return not arbitration_id & ERROR_FLAG and self.port.send(arbitration_id, data)
        except ValueError:
            return False

    def _pause(self, *, paused: bool) -> None:
        """Stop waiting for the host's frames while the bus takes none."""
        if paused != self._paused:
            self._paused = paused
            self._epoll.modify(self._socket.fileno(), 0 if paused else select.EPOLLIN)

    def _receive(self, frame: Frame) -> None:
        try:
            self._socket.send(wire.pack_frame(frame), socket.MSG_DONTWAIT)
        except BlockingIOError:
            self.lost += 1
        except OSError as error:  # no buffers, or the interface is down
            self.lost += 1
            self.problem = error

    def close(self) -> None:
        """Leave the bus and the interface."""
        self.port.detach()
        self._epoll.close()
        self._socket.close()


def _connect(interface: str, *, fd: bool) -> socket.socket:
    """Return a raw socket on a CAN interface.

    Raises
    ------
    OSError
        If the kernel has no CAN, there is no such interface, or it carries no CAN FD where that is
        asked for; the message names it.
    """
    try:
        connection = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    except OSError as error:
        text = f"{interface}: this kernel has no SocketCAN ({error.strerror})"
        raise OSError(error.errno, text) from error
    try:
        with contextlib.suppress(OSError):  # as much as the system allows
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        if fd:
            connection.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        connection.bind((interface,))
        if fd and _mtu(connection, interface) < wire.FD_FRAME.size:
            text = (
                f"carries no CAN FD; `ip link set {interface} mtu {wire.FD_FRAME.size}` changes it"
            )
            raise OSError(errno.EINVAL, text)
    except OSError as error:
        connection.close()
        raise OSError(error.errno, f"{interface}: {error.strerror}") from error
    return connection


def _mtu(connection: socket.socket, interface: str) -> int:
    """Return the maximum frame size of an interface [bytes]."""
    request = bytearray(_INTERFACE_REQUEST.pack(interface.encode(), 0))
    fcntl.ioctl(connection, _GET_MTU, request)
    return int(_INTERFACE_REQUEST.unpack(request)[1])
