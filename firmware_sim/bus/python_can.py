"""The python-can interface `simcan`: `can.Bus(interface="simcan", channel="simcan0")`.

It connects to a hub (`python -m firmware_sim`, or `python -m firmware_sim.bus`) of the same user.
It needs python-can and the standard library, nothing else of the simulator.

The wire
--------
The socket is a Unix SOCK_SEQPACKET: one datagram, one message, host byte order.

- hub to client, 24 bytes: SocketCAN's `struct can_frame` (id with CAN_EFF/RTR/ERR_FLAG u32,
  length u8, three reserved bytes, 8 data bytes), then CLOCK_MONOTONIC at the frame's completion in
  ns, u64. Bit 0 of byte 6 marks an own frame (`receive_own_messages`). A frame of CAN FD has 80
  bytes: `struct canfd_frame` (CANFD_BRS, ESI and FDF in byte 5, 64 data bytes), then the same.
- client to hub, 16 or 72 bytes: `struct can_frame` or `canfd_frame`.

So code which reads `bus.fileno()` itself can treat a SocketCAN raw socket and this one alike: read
into a buffer of 80 bytes or more; 16 or 24 bytes are a classic frame, 72 or 80 one of CAN FD; write
16 or 72 bytes. Both descriptors block: use MSG_DONTWAIT. Differences: an empty datagram means that
the hub is gone; a full queue is EAGAIN (ENOBUFS on SocketCAN); the socket's own time stamps are
those in the message.

First the client sends a hello (`wire.HELLO`) and gets a welcome (`wire.WELCOME`); acceptance
filters go to the hub (`wire.pack_filters`), so raw readers also get only the accepted frames.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import can
from can.typechecking import AutoDetectedConfig, CanFilters

from firmware_sim.bus import wire
from firmware_sim.bus.channels import running_channels, socket_paths
from firmware_sim.bus.frame import (
    ERROR_FLAG,
    EXTENDED_FLAG,
    EXTENDED_MASK,
    FD_LENGTHS,
    REMOTE_FLAG,
    Filter,
)

_HELLO_TIMEOUT_S = 5.0
_SEND_BUFFER = 16384  # about 40 frames; a robot's commands are stale long before that
_SEND_FLAGS = socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL
_BUS_OFF, _RESTARTED, _CONTROLLER = 0x40, 0x100, 0x04
_PASSIVE = 0x30
_ACTIVE = 0x40


class SimCanBus(can.BusABC):
    """A node on a simulated bus that runs in another process.

    Parameters
    ----------
    channel
        Name of the channel, or the path of its socket.
    can_filters
        As `can.BusABC.set_filters`; applied by the hub.
    receive_own_messages
        Whether sent messages come back (`is_rx` False) when they are complete on the bus.
    ignore_rx_error_frames
        Whether the controller's error messages are left out.
    listen_only
        Neither send nor acknowledge.
    node
        Name of the node on the bus; the program's name by default. A number is added to a name
        that is taken.
    bitrate
        Bit rate [bit/s]; must be the bus's, if given.
    fd
        Whether the node's controller supports CAN FD, which the bus must then carry.
    fd_tolerant
        Without `fd`, whether it ignores frames of CAN FD. By default it is a classic controller,
        which destroys them with error frames, for all.
    data_bitrate
        Data bit rate [bit/s]; must be the bus's, if given.
    kwargs
        Other options of python-can are ignored.

    Raises
    ------
    can.CanInitializationError
        If no hub of this channel runs, or it cannot be used.
    ValueError
        If the channel's name is invalid.
    """

    def __init__(
        self,
        channel: str = "simcan0",
        can_filters: CanFilters | None = None,
        *,
        receive_own_messages: bool = False,
        ignore_rx_error_frames: bool = False,
        listen_only: bool = False,
        node: str | None = None,
        bitrate: int | None = None,
        fd: bool = False,
        fd_tolerant: bool = False,
        data_bitrate: int | None = None,
        **kwargs: Any,
    ) -> None:
        self.channel = channel
        self._options = wire.Options(0)
        if receive_own_messages:
            self._options |= wire.Options.RECEIVE_OWN
        if not ignore_rx_error_frames:
            self._options |= wire.Options.ERRORS
        if listen_only:
            self._options |= wire.Options.LISTEN_ONLY
        if fd:
            self._options |= wire.Options.FD
        if fd_tolerant:
            self._options |= wire.Options.FD_TOLERANT
        self._can_protocol = can.CanProtocol.CAN_FD if fd else can.CanProtocol.CAN_20
        self._node = node or Path(sys.argv[0]).name or "python-can"
        self._state = can.BusState.ACTIVE
        self.socket = _connect(channel)
        try:
            self.bitrate, self.data_bitrate = self._greet()
            self.channel_info = f"simcan channel {channel!r} at {self.bitrate} bit/s"
            self._check(bitrate, data_bitrate)
            self._epoch_ns = time.time_ns() - time.monotonic_ns()
            self._readable = select.poll()
            self._readable.register(self.socket, select.POLLIN)
            self._writable = select.poll()
            self._writable.register(self.socket, select.POLLOUT)
            super().__init__(channel=channel, can_filters=can_filters, **kwargs)
        except BaseException:
            self.socket.close()
            raise

    def _check(self, bitrate: int | None, data_bitrate: int | None) -> None:
        """Compare the options with the bus; raises CanInitializationError."""
        if bitrate not in (None, self.bitrate):
            raise can.CanInitializationError(f"{self.channel_info}, not {bitrate}")
        if self._options & wire.Options.FD and not self.data_bitrate:
            raise can.CanInitializationError(
                f"{self.channel_info}: classic CAN, not CAN FD; start it with a data bit rate"
            )
        if data_bitrate not in (None, self.data_bitrate):
            raise can.CanInitializationError(
                f"{self.channel_info}: its data bit rate is {self.data_bitrate}, not {data_bitrate}"
            )

    def _greet(self) -> tuple[int, int]:
        """Exchange hello and welcome; return bit rate and data bit rate."""
        self.socket.settimeout(_HELLO_TIMEOUT_S)
        where = f"simcan channel {self.channel!r}"
        try:
            self.socket.send(wire.pack_hello(self._node, self._options))
            answer = self.socket.recv(wire.MAX_MESSAGE)
        except TimeoutError:
            raise can.CanInitializationError(
                f"{where}: the hub does not answer within {_HELLO_TIMEOUT_S:g} s"
            ) from None
        except OSError as error:
            raise can.CanInitializationError(f"{where}: {error.strerror}", error.errno) from error
        if len(answer) != wire.WELCOME.size or not answer.startswith(wire.WELCOME_MAGIC):
            raise can.CanInitializationError(
                f"{where}: refused" if not answer else f"{where}: the hub is of another version"
            )
        _, status, _, bitrate, data_bitrate, _ = wire.WELCOME.unpack(answer)
        if status != wire.Answer.OK:
            raise can.CanInitializationError(f"{where}: the hub refused, status {status}")
        self.socket.settimeout(None)
        return int(bitrate), int(data_bitrate)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand a message to the bus.

        Parameters
        ----------
        msg
            Data or remote frame, of CAN FD if the bus was opened with `fd`. Data between two
            lengths of CAN FD is padded with zeros, as by the SocketCAN interface.
        timeout
            Seconds to wait while the transmit queue is full; None or 0: not at all, as the
            SocketCAN interface does.

        Raises
        ------
        can.CanOperationError
            If the queue stays full, the hub is gone, or the node cannot send such a message.
        """
        if msg.is_error_frame:
            raise can.CanOperationError(f"{self.channel_info}: an error frame cannot be sent")
        if msg.is_fd and not self._options & wire.Options.FD:
            raise can.CanOperationError(
                f"{self.channel_info}: a CAN FD frame cannot be sent; open the bus with fd=True"
            )
        frame = _pack(msg)
        deadline = time.monotonic() + (timeout or 0.0)
        while True:
            try:
                self.socket.send(frame, _SEND_FLAGS)
            except BlockingIOError:
                rest = deadline - time.monotonic()
                if rest <= 0:
                    raise can.CanOperationError("Transmit buffer full", errno.ENOBUFS) from None
                self._writable.poll(min(rest * 1000 + 1, 10.0))
            except OSError as error:
                raise self._gone(error) from error
            else:
                return

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            if not self._readable.poll(None if timeout is None else max(0.0, timeout * 1000)):
                return None, True
            message = self.socket.recv(wire.STAMPED_FD_FRAME.size, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return None, True
        except OSError as error:
            raise self._gone(error) from error
        if not message:
            raise self._gone(None)
        return self._message(message), True

    def _gone(self, error: OSError | None) -> can.CanOperationError:
        code = errno.ENOTCONN if error is None else error.errno
        return can.CanOperationError(f"{self.channel_info}: the hub is gone", code)

    def _message(self, message: bytes) -> can.Message:
        is_fd = len(message) == wire.STAMPED_FD_FRAME.size
        layout = wire.STAMPED_FD_FRAME if is_fd else wire.STAMPED_FRAME
        can_id, length, flags, own, _, data, stamp_ns = layout.unpack(message)
        is_error = bool(can_id & ERROR_FLAG)
        is_remote = bool(can_id & REMOTE_FLAG)
        if is_error:
            self._note_state(can_id, data)
        return can.Message(
            timestamp=(stamp_ns + self._epoch_ns) * 1e-9,
            arbitration_id=can_id & EXTENDED_MASK,
            is_extended_id=bool(can_id & EXTENDED_FLAG),
            is_remote_frame=is_remote,
            is_error_frame=is_error,
            is_rx=not own & wire.OWN,
            is_fd=is_fd,
            bitrate_switch=bool(flags & wire.SWITCH),
            error_state_indicator=bool(flags & wire.PASSIVE),
            channel=self.channel,
            dlc=length,
            data=None if is_remote else data[:length],
        )

    def _note_state(self, can_id: int, data: bytes) -> None:
        if can_id & _BUS_OFF:
            self._state = can.BusState.ERROR
        elif can_id & _RESTARTED:
            self._state = can.BusState.ACTIVE
        elif can_id & _CONTROLLER and data[1] & (_PASSIVE | _ACTIVE | 0x0C):
            passive = bool(data[1] & _PASSIVE)
            self._state = can.BusState.PASSIVE if passive else can.BusState.ACTIVE

    @property
    def state(self) -> can.BusState:
        """State by the last error message received: ERROR is bus-off, PASSIVE error-passive.

        PASSIVE also while listening only. Needs `recv` to be called and error messages on.
        """
        if self._options & wire.Options.LISTEN_ONLY:
            return can.BusState.PASSIVE
        return self._state

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        if new_state is can.BusState.ERROR:
            raise ValueError("only ACTIVE and PASSIVE (listen only) can be set")
        if new_state is can.BusState.PASSIVE:
            self._options |= wire.Options.LISTEN_ONLY
        else:
            self._options &= ~wire.Options.LISTEN_ONLY
        self._tell(wire.pack_hello(self._node, self._options))

    def _apply_filters(self, filters: CanFilters | None) -> None:
        accept = [Filter(0, 0)] if filters is None else [_filter(entry) for entry in filters]
        self._tell(wire.pack_filters(accept))

    def _tell(self, message: bytes) -> None:
        try:
            self.socket.send(message, socket.MSG_NOSIGNAL)
        except BlockingIOError:
            raise can.CanOperationError("Transmit buffer full", errno.ENOBUFS) from None
        except OSError as error:
            raise self._gone(error) from error

    def fileno(self) -> int:
        """Return the socket's descriptor; the module's docstring describes its messages."""
        return self.socket.fileno()

    def shutdown(self) -> None:
        """Leave the bus; frames already sent still go out."""
        super().shutdown()
        self.socket.close()

    @staticmethod
    def _detect_available_configs() -> Sequence[AutoDetectedConfig]:
        return [{"interface": "simcan", "channel": channel} for channel in running_channels()]


def _connect(channel: str) -> socket.socket:
    """Connect to a channel's hub."""
    paths = socket_paths(channel)
    problems = []
    for path in paths:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
            connection.connect(os.fspath(path))
            _check_owner(connection, path)
        except (FileNotFoundError, ConnectionRefusedError, NotADirectoryError):
            connection.close()
            problems.append(f"no hub at {path}")
        except OSError as error:
            connection.close()
            problems.append(f"{path}: {error.strerror or error}")
        else:
            return connection
    others = ", ".join(running_channels()) or "none"
    raise can.CanInitializationError(
        f"simcan channel {channel!r}: {'; '.join(problems)}. Running channels: {others}. "
        "Start one with `python -m firmware_sim` or `python -m firmware_sim.bus`"
    )


def _check_owner(connection: socket.socket, path: Path) -> None:
    """Refuse a hub of another user, who could feed the robot false data."""
    layout = struct.Struct("3i")
    packed = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, layout.size)
    user = layout.unpack(packed)[1]
    if user not in (os.geteuid(), 0):
        raise PermissionError(errno.EPERM, f"the hub belongs to user {user}", os.fspath(path))


def _filter(entry: Any) -> Filter:
    can_id, mask = entry["can_id"], entry["can_mask"]
    if "extended" in entry:
        mask |= EXTENDED_FLAG
        can_id |= EXTENDED_FLAG if entry["extended"] else 0
    return Filter(can_id & 0xFFFF_FFFF, mask & 0xFFFF_FFFF)


def _pack(msg: can.Message) -> bytes:
    can_id = msg.arbitration_id
    if msg.is_extended_id:
        can_id |= EXTENDED_FLAG
    if msg.is_remote_frame:
        can_id |= REMOTE_FLAG
    data = b"" if msg.is_remote_frame or msg.data is None else bytes(msg.data)
    if not msg.is_fd:
        return wire.CAN_FRAME.pack(can_id, msg.dlc, 0, 0, 0, data)
    flags = wire.FDF
    if msg.bitrate_switch:
        flags |= wire.SWITCH
    if msg.error_state_indicator:
        flags |= wire.PASSIVE
    length = next(each for each in FD_LENGTHS if each >= len(data))
    return wire.FD_FRAME.pack(can_id, length, flags, 0, 0, data)
