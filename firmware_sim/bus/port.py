"""A node's place on the bus: its transmit queue, its acceptance filters, its error counters."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, NamedTuple

from firmware_sim.bus.bits import arbitration_key
from firmware_sim.bus.errors import ErrorCounters, ErrorState
from firmware_sim.bus.frame import MAX_DATA_LENGTH, Filter, Frame, check_id, exact_filters
from firmware_sim.bus.statistics import IdStatistics, PortStatistics

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus

Receive = Callable[[Frame], None]
"""Called with each accepted frame when it is complete."""

Offer = tuple[int, int, bytes]
"""A frame to send: arbitration key, id with flags, data."""

DEFAULT_QUEUE_LIMIT = 64


class Route(NamedTuple):
    """Where frames of one sender and one id go; made once, thrown away when the bus changes."""

    receivers: tuple[Receive, ...]
    ports: tuple[Port, ...]
    statistics: IdStatistics


class Tap(NamedTuple):
    """An observer and the ids that it sees; None: all, and errors."""

    observe: Receive
    ids: frozenset[int] | None


class Port:
    """A node's CAN controller and its driver's transmit queue. Made by `Bus.attach`.

    The queue is first in, first out, as Linux's default queue for CAN interfaces with a single
    transmit mailbox: an urgent frame waits behind the same node's earlier ones. It takes
    `queue_limit` frames besides the one being sent.

    Attributes
    ----------
    name
        Name of the node, unique on the bus.
    counters
        Error counters and state of the controller.
    queue_limit
        Frames which wait besides the one being sent.
    statistics
        Counters since the port was attached.
    """

    __slots__ = (
        "_acknowledges",
        "_babble",
        "_bus",
        "_closing",
        "_cut",
        "_detached",
        "_direct",
        "_errors",
        "_filters",
        "_heard",
        "_joining",
        "_listen_only",
        "_muted",
        "_on_sent",
        "_queue",
        "_ready_ns",
        "_receive",
        "_recovery",
        "_restart_ns",
        "_routes",
        "_sent_ids",
        "_unanswered",
        "counters",
        "name",
        "queue_limit",
        "statistics",
    )

    def __init__(
        self,
        bus: Bus,
        name: str,
        receive: Receive,
        *,
        accept: Iterable[int | Filter] | None,
        errors: bool,
        on_sent: Receive | None,
        queue_limit: int,
        restart_ns: int | None,
        listen_only: bool,
    ) -> None:
        self.name = name
        self.counters = ErrorCounters()
        self.statistics = PortStatistics()
        self._bus = bus
        self._receive = receive
        self._filters = None if accept is None else exact_filters(accept)
        self._errors = errors
        self._on_sent = on_sent
        self._queue: deque[Offer] = deque()
        self.queue_limit = queue_limit
        self._restart_ns = restart_ns
        self._listen_only = listen_only
        self._routes: dict[int, Route] = {}
        self._sent_ids: set[int] = set()
        self._babble: Offer | None = None
        self._ready_ns = 0
        self._recovery = 0
        self._acknowledges = True
        self._closing = self._cut = self._detached = self._joining = self._muted = False
        self._direct = self._heard = self._unanswered = False

    def send(self, arbitration_id: int, data: bytes | bytearray = b"") -> bool:
        """Queue a frame at the bus's present time.

        Parameters
        ----------
        arbitration_id
            11-bit id, or 29-bit id with `EXTENDED_FLAG`; with `REMOTE_FLAG` for a remote request.
        data
            0 to 8 bytes; of a remote request only the length counts.

        Returns
        -------
        bool
            False when the frame was not taken (ENOBUFS): the queue is full, the node is bus-off
            or only listens.

        Raises
        ------
        ValueError
            If the id or the length cannot be sent.
        RuntimeError
            If the port has been closed or detached.
        """
        if len(data) > MAX_DATA_LENGTH:
            raise ValueError(f"frame {arbitration_id:X}: {len(data)} data bytes, at most 8")
        if 0 <= arbitration_id <= 0x7FF:
            key = arbitration_id << 21
        else:
            check_id(arbitration_id)
            key = arbitration_key(arbitration_id)
        offer = key, arbitration_id, bytes(data)
        if not self._direct:
            return self._bus._send_checked(self, offer)
        queue = self._queue
        if not queue:
            self._bus._offers.append(self)
        elif len(queue) >= self.queue_limit:
            self.statistics.refused += 1
            return False
        queue.append(offer)
        return True

    @property
    def state(self) -> ErrorState:
        """State of the controller."""
        return self.counters.state

    @property
    def pending(self) -> int:
        """Frames in the queue, without the one being sent."""
        return len(self._queue)

    @property
    def room(self) -> int:
        """Frames which the queue still takes."""
        return max(0, self.queue_limit - len(self._queue))

    def has_sent(self, arbitration_id: int) -> bool:
        """Tell whether a frame of this id (with flags) has got through since the attachment.

        Of a port that has sent more than 4096 ids only the first of them are known.
        """
        return arbitration_id in self._sent_ids

    @property
    def attached(self) -> bool:
        """Whether the port is on the bus (a cut wire or bus-off does not change that)."""
        return not self._detached

    @property
    def listen_only(self) -> bool:
        """Whether the controller neither sends nor acknowledges."""
        return self._listen_only

    def accepts(self, arbitration_id: int) -> bool:
        """Tell whether frames of this id (with flags) pass the acceptance filters."""
        filters = self._filters
        return filters is None or any(entry.passes(arbitration_id) for entry in filters)

    def set_filters(self, accept: Iterable[int | Filter] | None) -> None:
        """Replace the acceptance filters: ids or `Filter`s; None accepts every frame."""
        self._filters = None if accept is None else exact_filters(accept)
        self._bus._rewire()

    def set_listen_only(self, listen_only: bool) -> None:
        """Only listen: send and acknowledge nothing. Frames still queued are discarded."""
        self._listen_only = listen_only
        if listen_only:
            self._discard_queue()
        self._bus._rewire()

    def restart(self) -> None:
        """Leave bus-off by hand: error-active after 128 x 11 recessive bits.

        Does nothing when the node is not bus-off or is recovering already.
        """
        self._bus._recovery.restart(self)

    def close(self) -> None:
        """Stop receiving, send what is queued, then leave the bus.

        What nobody acknowledges is given up, so that no ghost keeps on sending.
        """
        self._closing = True
        self._bus._rewire()
        self._bus._leave_if_done(self)

    def detach(self) -> None:
        """Leave the bus now; queued frames are discarded, one being sent is completed."""
        self._detached = True
        self._direct = False
        self._discard_queue()
        self._bus._remove(self)

    def _discard_queue(self) -> None:
        self.statistics.discarded += len(self._queue)
        self._queue.clear()

    @property
    def _on_bus(self) -> bool:
        """Whether the node's controller takes part in the traffic."""
        return not (self._cut or self._detached or self.counters.bus_off)

    @property
    def _listens(self) -> bool:
        """Whether frames reach the node's program."""
        return self._on_bus and not (self._joining or self._closing)

    @property
    def _answers(self) -> bool:
        """Whether the controller acknowledges frames of others."""
        return self._listens and self._acknowledges and not self._listen_only
