"""A node's place on the bus: its transmit queue, its acceptance filters, its error counters."""

from __future__ import annotations

from collections.abc import Iterable

from firmware_sim.bus.bits import arbitration_key
from firmware_sim.bus.errors import ErrorState
from firmware_sim.bus.frame import (
    CLASSIC_MAX,
    MAX_DATA_LENGTH,
    Filter,
    exact_filters,
)
from firmware_sim.bus.frame_faults import FrameFaults
from firmware_sim.bus.recovery import BusOffRecovery
from firmware_sim.bus.state import BusState, FdSupport, Offer, PortState


class Port:
    """A node program's view of its CAN controller and driver. Made by `Bus.attach`.

    The queue is first in, first out, as Linux's default queue for CAN interfaces with a single
    transmit mailbox: an urgent frame waits for the same node's earlier ones. It takes `queue_limit`
    frames besides the one being sent.

    Attributes
    ----------
    name
        Name of the node, unique on the bus.
    counters
        Error counters and state of the controller.
    statistics
        Counters since the port was attached.
    """

    __slots__ = ("_bus", "_faults", "_recovery", "_state", "counters", "name", "statistics")

    def __init__(
        self, state: PortState, bus: BusState, faults: FrameFaults, recovery: BusOffRecovery
    ) -> None:
        self.name = state.name
        self.counters = state.counters
        self.statistics = state.statistics
        self._state = state
        self._bus = bus
        self._faults = faults
        self._recovery = recovery

    def send(self, arbitration_id: int, data: bytes | bytearray = b"") -> bool:
        """Queue a frame at the bus's present time.

        Parameters
        ----------
        arbitration_id
            Id with flags as in `Frame`.
        data
            0 to 8 bytes, in CAN FD one of `FD_LENGTHS`; only the length of a remote request counts.

        Returns
        -------
        bool
            False when the frame was not taken (ENOBUFS): the queue is full, the node is bus-off
            or only listens.

        Raises
        ------
        ValueError
            If the frame is invalid, or of CAN FD on a classic bus or controller.
        RuntimeError
            If the port has been closed or detached.
        """
        if 0 <= arbitration_id <= 0x7FF and len(data) <= MAX_DATA_LENGTH:
            key = arbitration_id << 21
        else:
            self._bus.check(arbitration_id, len(data))
            if arbitration_id > CLASSIC_MAX and self._state.fd is not FdSupport.ENABLED:
                raise ValueError(f"frame {arbitration_id:X}: port {self.name!r} knows no CAN FD")
            key = arbitration_key(arbitration_id)
        offer = key, arbitration_id, bytes(data)
        state = self._state
        if not state.direct:
            return self._send_checked(offer)
        queue = state.queue
        if not queue:
            self._bus.offers.append(state)
        elif len(queue) >= state.queue_limit:
            self.statistics.refused += 1
            return False
        queue.append(offer)
        return True

    def _send_checked(self, offer: Offer) -> bool:
        """Take a frame where the port is not in the plain state."""
        state = self._state
        if state.detached or state.closing:
            raise RuntimeError(f"port {self.name!r} has left the bus")
        if state.counters.bus_off or state.listen_only or not self.room:
            self.statistics.refused += 1
            return False
        if self._bus.watches_sending:
            self._faults.sending(state, offer)
        else:
            self._bus.enqueue(state, offer)
        return True

    @property
    def state(self) -> ErrorState:
        """State of the controller."""
        return self.counters.state

    @property
    def queue_limit(self) -> int:
        """Frames which wait besides the one being sent."""
        return self._state.queue_limit

    @queue_limit.setter
    def queue_limit(self, limit: int) -> None:
        self._state.queue_limit = limit

    @property
    def pending(self) -> int:
        """Frames in the queue, without the one being sent."""
        return len(self._state.queue)

    @property
    def room(self) -> int:
        """Frames which the queue still takes."""
        return max(0, self._state.queue_limit - len(self._state.queue))

    def has_sent(self, arbitration_id: int) -> bool:
        """Return whether a frame of this id (with flags) has got through since the attachment.

        A port remembers the first 4096 ids that it has sent.
        """
        return arbitration_id in self._state.sent_ids

    @property
    def attached(self) -> bool:
        """Whether the port is on the bus (a cut wire or bus-off does not change that)."""
        return not self._state.detached

    @property
    def listen_only(self) -> bool:
        """Whether the controller neither sends nor acknowledges."""
        return self._state.listen_only

    def set_filters(self, accept: Iterable[int | Filter] | None) -> None:
        """Replace the acceptance filters: ids or `Filter`s; None accepts every frame."""
        self._state.filters = None if accept is None else exact_filters(accept)
        self._bus.rewire()

    def set_listen_only(self, listen_only: bool) -> None:
        """Only listen: send and acknowledge nothing. Frames still queued are discarded."""
        self._state.listen_only = listen_only
        if listen_only:
            self._state.discard_queue()
        self._bus.rewire()

    def restart(self) -> None:
        """Leave bus-off on request: error-active after 128 x 11 recessive bits.

        Does nothing when the node is not bus-off or is recovering already.
        """
        self._recovery.restart(self._state)

    def close(self) -> None:
        """Stop receiving, send what is queued, then leave the bus.

        Unacknowledged frames are given up, so that no ghost keeps sending.
        """
        self._state.closing = True
        self._bus.rewire()
        self._bus.detach_if_done(self._state)

    def detach(self) -> None:
        """Leave the bus now; queued frames are discarded, one being sent is completed."""
        self._bus.detach(self._state)
