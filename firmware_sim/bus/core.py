"""The simulated CAN bus: event-driven, on integer nanoseconds, bit-exact in length and order.

A frame starts when the bus is free and takes as many bit times as its stuffed bits; of several
waiting frames the arbitration field decides; receivers are called at the end of the end of frame.
Without errors a frame takes a short way through `advance`; as soon as an error counter stands
above zero, a fault is active, or two nodes send one id, `Confinement` takes over.

Time only moves in `advance`. A frame sent at the present time waits for the next `advance`
before it starts, so all frames sent at one time take part in one arbitration, in whatever order
they were sent.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable

import numpy as np

from firmware_sim.bus.bits import INTERMISSION_BITS, frame_bits
from firmware_sim.bus.confinement import Confinement, Failure
from firmware_sim.bus.disturbance import Disturbance
from firmware_sim.bus.faults import Fault, FaultPlan
from firmware_sim.bus.frame import Filter, Frame
from firmware_sim.bus.injection import Injector
from firmware_sim.bus.port import DEFAULT_QUEUE_LIMIT, Offer, Port, Receive, Route, Tap
from firmware_sim.bus.recovery import Recovery
from firmware_sim.bus.statistics import BusStatistics, LoadMeter

NEVER_NS = 1 << 62
"""A time that does not come (146 years)."""

_MAX_ROUTES = 4096


class Bus:
    """A CAN bus on which nodes are attached as ports.

    Parameters
    ----------
    bitrate
        Bits per second; a bit must last whole nanoseconds (1 000 000, 800 000, 500 000, 250 000,
        125 000, 100 000, ... do).
    seed
        Seed of the faults' random draws, or a generator to draw from. The bus without random
        faults draws nothing.
    faults
        Faults of the run; more can be added by `inject`.
    start_ns
        Time at which the bus starts (ns).
    load_window_ns
        Window of `load` (ns).

    Attributes
    ----------
    now_ns
        Present time of the bus (ns).
    bit_ns
        Length of a bit (ns).
    statistics
        Counters per id and per kind of error.
    """

    def __init__(
        self,
        bitrate: int = 1_000_000,
        seed: int | np.random.Generator = 0,
        *,
        faults: FaultPlan | None = None,
        start_ns: int = 0,
        load_window_ns: int = 1_000_000_000,
    ) -> None:
        if bitrate <= 0 or 1_000_000_000 % bitrate:
            raise ValueError(f"bitrate {bitrate}: a bit must last whole nanoseconds")
        self.bitrate = bitrate
        self.bit_ns = 1_000_000_000 // bitrate
        self.now_ns = start_ns
        self.statistics = BusStatistics()
        self._intermission_ns = INTERMISSION_BITS * self.bit_ns
        self._ports: dict[str, Port] = {}
        self._taps: list[Tap] = []
        self._offers: list[Port] = []
        self._senders: tuple[Port, ...] = ()
        self._offer: Offer = (0, 0, b"")
        self._failure: Failure | None = None
        self._bits = 0
        self._start_ns = start_ns
        self._done_ns = 0
        self._free_ns = start_ns
        self._timers: list[tuple[int, int, Callable[[], None]]] = []
        self._timer_ns = NEVER_NS
        self._timer_number = 0
        self._slow = False
        self._advancing = False
        self._until_ns = start_ns
        self._meter = LoadMeter(self.bit_ns, load_window_ns, start_ns)
        self._confinement = Confinement(self)
        self._recovery = Recovery(self)
        self._disturbance = Disturbance(self)
        self._injector = Injector(self, np.random.default_rng(seed))
        for fault in () if faults is None else faults.faults:
            self._injector.add(fault)
        self._rewire()

    def attach(
        self,
        name: str,
        receive: Receive,
        *,
        accept: Iterable[int | Filter] | None = None,
        errors: bool = False,
        on_sent: Receive | None = None,
        queue_limit: int = DEFAULT_QUEUE_LIMIT,
        restart_ms: int | None = 0,
        listen_only: bool = False,
    ) -> Port:
        """Put a node on the bus.

        Parameters
        ----------
        name
            Name of the node, unique on the bus; faults refer to it.
        receive
            Called with each accepted frame of other nodes, at the time it is complete. It may
            send, attach and detach, but not advance the bus.
        accept
            Ids (with flags) or `Filter`s that reach `receive`; None: all. The controller
            acknowledges and counts all frames all the same.
        errors
            Whether `receive` also gets the controller's error messages (`ERROR_FLAG` in the id,
            contents as in linux/can/error.h): errors on the wire which changed its counters, and
            changes of state. A lone node's endless acknowledge errors stop being reported when
            its counter stands still.
        on_sent
            Called with each own frame when it is complete (FMI-LS-BUS: Confirm).
        queue_limit
            Frames which wait besides the one being sent.
        restart_ms
            After bus-off, wait so long (ms) before the recovery of 128 x 11 recessive bits begins;
            None: only `Port.restart` begins it.
        listen_only
            The controller neither sends nor acknowledges.

        Raises
        ------
        ValueError
            If the name is taken or a limit is out of range.
        """
        if name in self._ports:
            raise ValueError(f"port {name!r}: the name is taken on this bus")
        if queue_limit < 1 or (restart_ms is not None and restart_ms < 0):
            raise ValueError(f"port {name!r}: queue_limit {queue_limit}, restart_ms {restart_ms}")
        port = Port(
            self,
            name,
            receive,
            accept=accept,
            errors=errors,
            on_sent=on_sent,
            queue_limit=queue_limit,
            restart_ns=None if restart_ms is None else restart_ms * 1_000_000,
            listen_only=listen_only,
        )
        port._joining = bool(self._senders)
        self._ports[name] = port
        self._injector.attached(port)
        self._rewire()
        return port

    def tap(self, observe: Receive, *, accept: Iterable[int] | None = None) -> None:
        """Let an observer see every completed frame and every error on the wire.

        With `accept` it sees only frames of these ids (with flags), and no errors.

        It is no node: it neither acknowledges nor has error counters. Errors come as SocketCAN
        error messages of class BUSERROR, as a counter-less receiver would report them; those which
        change no node's counters (a lone error-passive node's) do not.
        """
        self._taps.append(Tap(observe, None if accept is None else frozenset(accept)))
        self._rewire()

    def inject(self, fault: Fault) -> None:
        """Add a fault to the plan; its window may have begun already."""
        self._injector.add(fault)
        self._rewire()

    @property
    def ports(self) -> tuple[Port, ...]:
        """All attached ports, in the order of their attachment."""
        return tuple(self._ports.values())

    def load(self) -> float:
        """Share [0, 1] of time the bus was busy in the last window."""
        return self._meter.load(self.now_ns)

    def schedule(self, due_ns: int, action: Callable[[], None]) -> None:
        """Have `action` called when time reaches `due_ns` (at once where it has passed).

        For the timers of nodes. The action may send, attach and detach, but not advance the bus.
        It runs before a frame that is complete at the same instant.
        """
        self._timer_number += 1
        heapq.heappush(self._timers, (max(due_ns, self.now_ns), self._timer_number, action))
        self._timer_ns = self._timers[0][0]

    @property
    def next_event_ns(self) -> int | None:
        """Time of the next thing to happen if nobody sends anything more; None: nothing will.

        A real-time server sleeps until then, or until somebody has sent a frame. The endless
        attempts of a lone error-passive node do not count as events.
        """
        due = self._timer_ns
        if self._confinement.hopeless and len(self._senders) + len(self._offers) == 1:
            pass
        elif self._senders:
            due = min(self._done_ns, due)
        elif self._offers:
            start = self._next_start_ns()
            _, arbitration_id, data = min(port._queue[0] for port in self._offers)
            due = min(due, start + frame_bits(arbitration_id, data) * self.bit_ns)
        return None if due >= NEVER_NS else due

    def advance(self, until_ns: int) -> None:
        """Let time pass: run all events up to and including `until_ns`.

        Raises
        ------
        ValueError
            If `until_ns` lies in the past.
        RuntimeError
            If called from within a receiver.
        """
        if until_ns < self.now_ns:
            raise ValueError(f"cannot go back from {self.now_ns} ns to {until_ns} ns")
        if self._advancing:
            raise RuntimeError("Bus.advance called from within a receiver")
        self._advancing = True
        self._until_ns = until_ns
        try:
            self._run(until_ns)
            self.now_ns = until_ns
        finally:
            self._advancing = False

    def _run(self, until_ns: int) -> None:
        """Run timers, starts of frames and ends of frames in the order of their times."""
        while True:
            busy = self._senders
            if busy:
                due_ns, last_ns = self._done_ns, until_ns
            elif self._offers:
                due_ns, last_ns = self._free_ns, until_ns - 1
                if self._slow:
                    due_ns = self._next_start_ns()
                elif due_ns < self.now_ns:
                    due_ns = self.now_ns
            else:
                due_ns, last_ns = NEVER_NS, until_ns
            if self._timer_ns <= due_ns:
                if self._timer_ns > until_ns:
                    return
                self._run_timer()
            elif due_ns > last_ns:
                return
            else:
                self.now_ns = due_ns
                if busy:
                    self._end_attempt(due_ns)
                else:
                    self._arbitrate(due_ns)

    def _run_timer(self) -> None:
        due_ns, _, action = heapq.heappop(self._timers)
        self._timer_ns = self._timers[0][0] if self._timers else NEVER_NS
        self.now_ns = due_ns
        action()

    def _next_start_ns(self) -> int:
        """Time at which the next of the offered frames may start."""
        ready = min(port._ready_ns for port in self._offers)
        return max(self._free_ns, self.now_ns, ready)

    def _arbitrate(self, start_ns: int) -> None:
        """Let the most urgent of the offered frames start."""
        offers = self._offers
        winner = offers[0]
        tie = False
        contested = len(offers) > 1
        if contested:
            key = winner._queue[0][0]
            for port in offers:
                other = port._queue[0][0]
                if other < key:
                    winner, key, tie = port, other, False
                elif other == key and port is not winner:
                    tie = True
        self._start_ns = start_ns
        if tie or self._slow or not winner._heard:
            self._confinement.begin(start_ns)
            return
        if contested:
            for port in offers:
                port.statistics.arbitration_lost += 1
            winner.statistics.arbitration_lost -= 1
        queue = winner._queue
        offer = queue.popleft()
        if not queue:
            offers.remove(winner)
        self._senders = (winner,)
        self._offer = offer
        self._bits = bits = frame_bits(offer[1], offer[2])
        self._done_ns = start_ns + bits * self.bit_ns

    def _end_attempt(self, done_ns: int) -> None:
        """Complete the frame on the wire, or destroy it as was decided at its start."""
        if self._failure is not None:
            self._confinement.fail()
            return
        senders = self._senders
        sender = senders[0]
        self._senders = ()
        self._free_ns = done_ns + self._intermission_ns
        _, arbitration_id, data = self._offer
        route = sender._routes.get(arbitration_id)
        if route is None:
            route = self._route(sender, arbitration_id)
        bits = self._bits + INTERMISSION_BITS
        statistics = route.statistics
        statistics.frames += 1
        statistics.bits += bits
        meter = self._meter
        meter.busy_bits += bits
        if done_ns >= meter.next_mark_ns:
            meter.mark(done_ns)
        frame = Frame(arbitration_id, data, done_ns)
        if self._slow or len(senders) > 1:
            self._confinement.complete(senders, route, frame)
            return
        sender.statistics.sent += 1
        for receive in route.receivers:
            receive(frame)
        if sender._on_sent is not None:
            sender._on_sent(frame)

    def _route(self, sender: Port, arbitration_id: int) -> Route:
        """Find out who gets a sender's frames of one id."""
        ports = tuple(
            port
            for port in self._ports.values()
            if port is not sender and port._listens and port.accepts(arbitration_id)
        )
        receivers = (*self._observers(arbitration_id), *(port._receive for port in ports))
        route = Route(receivers, ports, self.statistics.of(arbitration_id))
        if len(sender._routes) >= _MAX_ROUTES:
            sender._routes.clear()
        if len(sender._sent_ids) < _MAX_ROUTES:
            sender._sent_ids.add(arbitration_id)
        sender._routes[arbitration_id] = route
        return route

    def _observers(self, arbitration_id: int) -> tuple[Receive, ...]:
        """Return who sees frames or error messages of an id without being a node."""
        return tuple(
            tap.observe for tap in self._taps if tap.ids is None or arbitration_id in tap.ids
        )

    def _rewire(self) -> None:
        """Work out anew what depends on who is on the bus and in which state."""
        self._confinement.hopeless = False
        answering = [port for port in self._ports.values() if port._answers]
        for port in self._ports.values():
            port._routes.clear()
            port._heard = not port._unanswered and any(other is not port for other in answering)
            port._direct = (
                port._on_bus
                and not (port._muted or port._closing or port._listen_only)
                and not self._injector.watches_sending
            )
        self._offers[:] = [port for port in self._ports.values() if port._queue and port._on_bus]
        self._reconsider()

    def _reconsider(self) -> None:
        """Decide whether frames may take the short way."""
        now_ns = self.now_ns
        self._slow = self._injector.watches_wire or any(
            port.counters.tec
            or port.counters.rec
            or port._joining
            or port._closing
            or port._ready_ns > now_ns
            for port in self._ports.values()
        )

    def _send_checked(self, port: Port, offer: Offer) -> bool:
        """Take a frame from a port which is not in the plain state (see `Port.send`)."""
        if port._detached or port._closing:
            raise RuntimeError(f"port {port.name!r} has left the bus")
        if port.counters.bus_off or port._listen_only or len(port._queue) >= port.queue_limit:
            port.statistics.refused += 1
            return False
        if self._injector.watches_sending:
            self._injector.sending(port, offer)
        else:
            self._enqueue(port, offer)
        return True

    def _enqueue(self, port: Port, offer: Offer, *, first: bool = False) -> None:
        """Put a frame into a port's queue, whatever its limit, and offer it to the bus."""
        if port._muted or not port.attached or port.counters.bus_off:
            port.statistics.discarded += 1
            return
        if first:
            port._queue.appendleft(offer)
        else:
            port._queue.append(offer)
        if len(port._queue) == 1:
            if port._cut:
                self._disturbance.send_alone(port)
            else:
                self._offers.append(port)

    def _leave_if_done(self, port: Port) -> None:
        """Take a closing port off the bus once all its frames are out or cannot get out."""
        done = not port._queue and port not in self._senders
        if done or not port._on_bus:
            port.detach()

    def _remove(self, port: Port) -> None:
        if self._ports.get(port.name) is port:
            del self._ports[port.name]
        self._rewire()
