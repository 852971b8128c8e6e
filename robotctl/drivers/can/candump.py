"""A log of the host's CAN bus as `candump -L` writes it, readable by python-can and can-utils.

The logger has its own socket, so it costs the control process nothing. On SocketCAN it also
receives the frames of this computer, like every other socket.
"""

from __future__ import annotations

import socket
import struct
import time
from typing import Final

import can

from robotctl.drivers.can.config import CanConfig
from robotctl.drivers.can.descriptor import (
    BIT_RATE_SWITCH,
    CAN_EFF_MASK,
    CAN_SFF_MASK,
    ERROR_STATE,
    FD_FRAME,
    FRAME,
    Descriptor,
)
from robotctl.drivers.can.errors import CAN_ERR_FLAG
from robotctl.messages.ports import EXTENDED_FLAG, REMOTE_FLAG, Clock
from robotctl.runtime.clock import wall_offset_ns

_STAMP: Final = struct.Struct("=q")
_TIMESPEC: Final = struct.Struct("@ll")
_ANCILLARY_SIZE: Final = socket.CMSG_SPACE(_TIMESPEC.size)
_STAMPED_SIZES: Final = frozenset({FRAME.size + _STAMP.size, FD_FRAME.size + _STAMP.size})
_FD_FLAGS: Final = BIT_RATE_SWITCH | ERROR_STATE
_BUFFER_BYTES: Final = 1 << 20
_MESSAGE_BYTES: Final = 128
_MOST_FRAMES: Final = 4096
"""Size of the kernel's buffer and of a frame's [B], and maximum number of frames in one reading."""


def candump_line(message: bytes, time_us: int, channel: str) -> str:
    """Return a frame as one line with its line end.

    Parameters
    ----------
    message
        A `struct can_frame` or, of 72 bytes and more, `canfd_frame`, followed by anything.
    time_us
        Wall time [us since 1970].
    channel
        Name of the bus.
    """
    fd_flags = None
    if len(message) >= FD_FRAME.size:
        can_id, length, fd_flags, data = FD_FRAME.unpack_from(message)
    else:
        can_id, length, data = FRAME.unpack_from(message)
    text = data[:length].hex().upper()
    if can_id & CAN_ERR_FLAG:
        name = f"{can_id & (CAN_ERR_FLAG | CAN_EFF_MASK):08X}"
    elif can_id & EXTENDED_FLAG:
        name = f"{can_id & CAN_EFF_MASK:08X}"
    else:
        name = f"{can_id & CAN_SFF_MASK:03X}"
    if fd_flags is not None:
        text = f"#{fd_flags & _FD_FLAGS:X}{text}"
    elif can_id & REMOTE_FLAG:
        text = f"R{length}" if length else "R"
    return f"({time_us // 1_000_000:010d}.{time_us % 1_000_000:06d}) {channel} {name}#{text}\n"


class CandumpReader:
    """Listens to a bus.

    Parameters
    ----------
    config
        Which bus.
    epoch_ns
        Added to the clock to get the wall time of the log [ns].
    clock
        That of simcan's stamps; CLOCK_MONOTONIC by default.

    Raises
    ------
    OSError, can.CanError, ValueError
        If the bus cannot be opened now.
    """

    def __init__(self, config: CanConfig, epoch_ns: int, clock: Clock | None = None) -> None:
        self._channel = config.channel
        self._epoch_ns = epoch_ns
        self._now_ns = time.monotonic_ns if clock is None else clock.now_ns
        self._gone: OSError | None = None
        bus = can.Bus(
            interface=config.interface,
            channel=config.channel,
            fd=config.data_bitrate > 0,
            listen_only=True,
            node="recorder",
        )
        try:
            self._descriptor = Descriptor(bus)
        except OSError:
            bus.shutdown()
            raise
        self._descriptor.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)

    def read(self) -> list[str]:
        """Return the lines of all frames since the last call, without waiting.

        Raises
        ------
        OSError
            If the bus has gone; the last frames before that are returned first.
        """
        if self._gone is not None:
            raise self._gone
        lines: list[str] = []
        try:
            if self._descriptor.kernel:
                self._drain_kernel(lines)
            else:
                self._drain(lines)
        except BlockingIOError:
            pass
        except OSError as error:
            if not lines:
                raise
            self._gone = error
        return lines

    def _drain(self, lines: list[str]) -> None:
        """Take frames of simcan, stamped by the clock."""
        receive = self._descriptor.socket.recv
        for _ in range(_MOST_FRAMES):
            message = receive(_MESSAGE_BYTES)
            if not message:
                raise ConnectionResetError("the bus has hung up")
            if len(message) in _STAMPED_SIZES:
                (stamp_ns,) = _STAMP.unpack_from(message, len(message) - _STAMP.size)
                lines.append(self._line(message, stamp_ns))

    def _drain_kernel(self, lines: list[str]) -> None:
        """Take frames of SocketCAN, stamped by CLOCK_REALTIME, which may be set meanwhile."""
        offset_ns = wall_offset_ns(self._now_ns)
        receive = self._descriptor.socket.recvmsg
        for _ in range(_MOST_FRAMES):
            message, ancillary, _flags, _address = receive(_MESSAGE_BYTES, _ANCILLARY_SIZE)
            stamp_ns = self._now_ns()
            if ancillary:
                seconds, nanoseconds = _TIMESPEC.unpack_from(ancillary[0][2])
                stamp_ns = seconds * 1_000_000_000 + nanoseconds - offset_ns
            lines.append(self._line(message, stamp_ns))

    def _line(self, message: bytes, stamp_ns: int) -> str:
        """Return one frame as a line."""
        return candump_line(message, (stamp_ns + self._epoch_ns) // 1000, self._channel)

    def close(self) -> None:
        """Leave the bus."""
        self._descriptor.close()
