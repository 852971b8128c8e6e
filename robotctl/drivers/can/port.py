"""A CAN bus through its raw descriptor: SocketCAN, and simcan, which speaks the same frames.

python-can opens and configures the bus; the hot path then uses the descriptor itself, which costs
a third of `Bus.send` and `Bus.recv`. Nothing here raises into the loop, waits, or runs in a thread.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
import time
from collections.abc import Callable, Collection
from typing import Final

import can

from robotctl.drivers.can.bus_meter import FRAME_BITS, BusMeter
from robotctl.drivers.can.config import CanConfig, bring_up
from robotctl.drivers.can.descriptor import (
    BIT_RATE_SWITCH,
    CAN_SFF_MASK,
    FD_FRAME,
    FDF,
    FRAME,
    Descriptor,
    OpenDescriptor,
    opener,
)
from robotctl.drivers.can.errors import CAN_ERR_FLAG, bus_state
from robotctl.errors import LinkError
from robotctl.messages.control import BusState, BusStatus
from robotctl.messages.ports import FD_FLAG, Clock, Frame

RETRY_NS: Final = 500_000_000
"""Interval between attempts to open a bus that went down [ns]."""

DRAIN_LIMIT: Final = 256
"""Frames taken in one `receive`; a babbling node must not hold the loop. The rest waits."""

# Bound once: a method of an imported name is looked up anew by each call.
_PACK, _UNPACK = FRAME.pack, FRAME.unpack_from
_FRAME_SIZE = FRAME.size
_STAMP = struct.Struct("=q")
_STAMPED_SIZE = _FRAME_SIZE + _STAMP.size
_FD_SIZES = frozenset({FD_FRAME.size, FD_FRAME.size + _STAMP.size})
_TIMESPEC = struct.Struct("@ll")
_ANCILLARY_SIZE = socket.CMSG_SPACE(_TIMESPEC.size)
_MAX_CLOCK_STEP_NS = 1_000_000
_MAX_AGE_NS = 10_000_000_000
"""Maximum change of the wall clock between two frames, and maximum age of a frame, for a stamp to
count [ns]."""
_BUFFER_FULL = frozenset({errno.EAGAIN, errno.ENOBUFS, errno.EINTR})


class SocketPort:
    """A `CanPort` on a socket that carries `struct can_frame` and, with CAN FD, `canfd_frame`.

    A full transmit queue (ENOBUFS, EAGAIN) refuses the frame and no more, and so does a bus that
    carries no such frame. Any other error takes the port DOWN; from then on `receive` tries to open
    the bus again, at most each `RETRY_NS`.
    Fails to know the controller's state before its first error frame: it starts as error active.

    Parameters
    ----------
    config
        Which bus.
    arbitration_ids
        Accepted identifiers, with flags as in `Frame`; all others stay in the kernel. None: all
        are accepted.
    clock
        CLOCK_MONOTONIC.
    open_descriptor
        How to open the bus, for tests.

    Raises
    ------
    LinkError
        If the bus cannot be opened at the start.
    """

    def __init__(
        self,
        config: CanConfig,
        arbitration_ids: Collection[int] | None,
        clock: Clock,
        open_descriptor: OpenDescriptor | None = None,
    ) -> None:
        self._clock = clock
        self._open = open_descriptor or opener(config, arbitration_ids)
        self._meter = BusMeter(config)
        self._wanted = self._meter.accepted(arbitration_ids)
        self._fd_flags = FDF
        """Flags of the frames of CAN FD that this port sends."""
        if config.data_bitrate > config.bitrate:
            self._fd_flags |= BIT_RATE_SWITCH
        self._descriptor: Descriptor | None = None
        self._send: Callable[[bytes], int] = _send_nowhere
        self._retry_ns = 0
        self._closed = False
        self._buffer = bytearray(128)
        self._offset_ns = 0
        try:
            self._connect()
        except (OSError, can.CanError, ValueError) as error:
            raise LinkError(_explanation(config, error)) from error

    def send(self, arbitration_id: int, data: bytes) -> bool:
        """Queue one frame without waiting; False if the bus did not take it."""
        if arbitration_id > CAN_SFF_MASK:
            return self._send_other(arbitration_id, data)
        length = len(data)
        try:
            self._send(_PACK(arbitration_id, length, data))
        except OSError as error:
            return self._refuse(error)
        meter = self._meter
        meter.sent += 1
        meter.bits += FRAME_BITS[length]
        return True

    def _send_other(self, arbitration_id: int, data: bytes) -> bool:
        """Send a frame that has more than an 11-bit identifier, if the bus carries it."""
        meter, length = self._meter, len(data)
        bits = meter.measure(arbitration_id, length)
        if not bits:
            meter.send_failures += 1
            return False
        if arbitration_id < FD_FLAG:
            message = _PACK(arbitration_id, length, data)
        else:
            message = FD_FRAME.pack(arbitration_id ^ FD_FLAG, length, self._fd_flags, data)
        try:
            self._send(message)
        except OSError as error:
            return self._refuse(error)
        meter.sent += 1
        meter.bits += bits
        return True

    def _refuse(self, error: OSError) -> bool:
        """Count a frame that the socket refused; return False."""
        self._meter.send_failures += 1
        # A full queue refuses one frame; anything else means that the bus is gone.
        if error.errno not in _BUFFER_FULL and self._descriptor is not None:
            self._fail()
        return False

    def receive(self) -> list[Frame]:
        """Return, without waiting, the frames received since the last call, oldest first."""
        now_ns = self._clock.now_ns()
        if self._descriptor is None and not self._closed and now_ns >= self._retry_ns:
            self._reopen(now_ns)
        frames: list[Frame] = []
        descriptor = self._descriptor
        if descriptor is not None:
            try:
                if descriptor.kernel:
                    self._drain_kernel(descriptor, now_ns, frames)
                else:
                    self._drain(descriptor, now_ns, frames)
            except BlockingIOError:  # what waited is gone
                pass
            except OSError:
                self._fail()
            self._meter.received += len(frames)
        self._meter.roll(now_ns)
        return frames

    def status(self) -> BusStatus:
        """Return the state of the controller and the counters since the start."""
        return self._meter.status()

    def close(self) -> None:
        """Release the bus; nothing is sent or received afterwards."""
        self._closed = True
        self._fail()

    def _connect(self) -> None:
        """Open the bus; raises the exceptions of the socket or python-can."""
        descriptor = self._open()
        pending = descriptor.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if pending:
            descriptor.close()
            raise OSError(pending, os.strerror(pending))
        self._descriptor = descriptor
        self._send = descriptor.socket.send
        self._offset_ns = self._wall_offset_ns()
        self._meter.state = BusState.ERROR_ACTIVE

    def _reopen(self, now_ns: int) -> None:
        """Try to open a bus that went down."""
        self._retry_ns = now_ns + RETRY_NS
        try:
            self._connect()
        except (OSError, can.CanError, ValueError):
            self._meter.state = BusState.DOWN

    def _fail(self) -> None:
        """Close the descriptor; the next attempt to open it is after `RETRY_NS`."""
        self._meter.state = BusState.DOWN
        self._retry_ns = self._clock.now_ns() + RETRY_NS
        self._send = _send_nowhere
        if self._descriptor is not None:
            self._descriptor.close()
            self._descriptor = None

    def _drain(self, descriptor: Descriptor, now_ns: int, frames: list[Frame]) -> None:
        """Take frames of simcan: a frame, then its CLOCK_MONOTONIC stamp if it has one."""
        buffer, waits, receive = self._buffer, descriptor.waits, descriptor.socket.recv_into
        for _ in range(DRAIN_LIMIT):
            if not waits(0):
                return
            size = receive(buffer)
            if size == _STAMPED_SIZE:
                (stamp_ns,) = _STAMP.unpack_from(buffer, _FRAME_SIZE)
                self._take(now_ns, stamp_ns, frames)
            elif size == _FRAME_SIZE:
                self._take(now_ns, now_ns, frames)
            elif size == 0:
                raise ConnectionResetError(errno.ECONNRESET, "the bus has hung up")
            elif size in _FD_SIZES:
                stamp_ns = now_ns
                if size > FD_FRAME.size:
                    (stamp_ns,) = _STAMP.unpack_from(buffer, FD_FRAME.size)
                self._take_fd(now_ns, stamp_ns, frames)
            else:
                self._meter.error_frames += 1

    def _drain_kernel(self, descriptor: Descriptor, now_ns: int, frames: list[Frame]) -> None:
        """Take frames of SocketCAN; their CLOCK_REALTIME stamps become monotonic ones.

        Where the wall clock has been set since the last drain, stamps mean nothing and the present
        time takes their place. Frames that waited for long stay old.
        """
        offset_ns = self._wall_offset_ns()
        steady = abs(offset_ns - self._offset_ns) < _MAX_CLOCK_STEP_NS
        self._offset_ns = offset_ns
        buffers, waits, receive = [self._buffer], descriptor.waits, descriptor.socket.recvmsg_into
        for _ in range(DRAIN_LIMIT):
            if not waits(0):
                return
            size, ancillary, _, _ = receive(buffers, _ANCILLARY_SIZE)
            stamp_ns = now_ns
            if ancillary and steady:
                seconds, nanoseconds = _TIMESPEC.unpack_from(ancillary[0][2])
                stamp_ns = seconds * 1_000_000_000 + nanoseconds - offset_ns
                if stamp_ns < now_ns - _MAX_AGE_NS:  # this process stood for long, or it was set
                    steady = abs(self._wall_offset_ns() - offset_ns) < _MAX_CLOCK_STEP_NS
                    stamp_ns = stamp_ns if steady else now_ns
            if size == _FRAME_SIZE:
                self._take(now_ns, stamp_ns, frames)
            else:
                self._take_fd(now_ns, stamp_ns, frames)

    def _wall_offset_ns(self) -> int:
        """Return how far the wall clock is ahead of this port's [ns]."""
        return time.time_ns() - self._clock.now_ns()

    def _take(self, now_ns: int, stamp_ns: int, frames: list[Frame]) -> None:
        """Keep the frame in the buffer if it is wanted; note it if it is an error frame."""
        can_id, length, data = _UNPACK(self._buffer)
        bits = self._wanted.get(can_id)
        if bits is not None:
            self._meter.bits += bits[min(length, 8)]
            received_ns = stamp_ns if stamp_ns < now_ns else now_ns
            # A third of the time of Frame(...), which is a function in Python.
            frames.append(tuple.__new__(Frame, (can_id, data[:length], received_ns)))
        elif can_id & CAN_ERR_FLAG:
            meter = self._meter
            meter.error_frames += 1
            meter.state = bus_state(can_id & ~CAN_ERR_FLAG, data, meter.state)

    def _take_fd(self, now_ns: int, stamp_ns: int, frames: list[Frame]) -> None:
        """Keep the frame of CAN FD in the buffer if it is wanted."""
        can_id, length, _, data = FD_FRAME.unpack_from(self._buffer)
        arbitration_id = can_id | FD_FLAG
        bits = self._wanted.get(arbitration_id)
        if bits is not None:
            data = data[:length]
            self._meter.bits += bits[len(data)]
            frames.append(Frame(arbitration_id, data, min(stamp_ns, now_ns)))


def _send_nowhere(_: bytes) -> int:
    """Stand in for the socket of a bus that is down."""
    raise OSError(errno.ENETDOWN, "the bus is down")


def _explanation(config: CanConfig, error: Exception) -> str:
    """Say what could not be opened, and how it comes up."""
    text = f"{config.interface} {config.channel}: cannot be opened: {error}"
    if config.interface == "socketcan":
        text += f"; bring it up with `{bring_up(config)}`"
    return text
