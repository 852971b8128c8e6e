"""The simulated CAN bus: event-driven, on integer nanoseconds, bit-exact in length and order.

A frame starts when the bus is free and takes as many bit times as its stuffed bits; among
waiting frames the arbitration field decides; receivers are called at the end of the end of frame.
Without errors a frame takes a short path through `advance`; as soon as an error counter is above
zero, a fault is active, or two nodes send one id, `Confinement` takes over.

Time only moves in `advance`. A frame sent at the present time waits for the next `advance`
before it starts, so all frames sent at one time take part in one arbitration, in whatever order
they were sent.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable

import numpy as np

from firmware_sim.bus.bits import INTERMISSION_BITS, frame_bits
from firmware_sim.bus.confinement import Confinement
from firmware_sim.bus.disturbance import Disturbance
from firmware_sim.bus.faults import Fault, FaultPlan
from firmware_sim.bus.fd_bits import frame_length
from firmware_sim.bus.frame import CLASSIC_MAX, Filter, Frame, exact_filters
from firmware_sim.bus.frame_faults import FrameFaults
from firmware_sim.bus.injection import Injector
from firmware_sim.bus.port import Port
from firmware_sim.bus.recovery import BusOffRecovery
from firmware_sim.bus.state import (
    NEVER_NS,
    BusState,
    FdSupport,
    PortState,
    Receive,
    Route,
    Tap,
)
from firmware_sim.bus.statistics import LoadMeter

DEFAULT_QUEUE_LIMIT = 64
_MAX_ROUTES = 4096


class Bus:
    """A CAN bus on which nodes are attached as ports.

    Parameters
    ----------
    bitrate
        Bits per second; a bit must last whole nanoseconds (1 000 000, 800 000, 500 000, 250 000,
        125 000, 100 000, ... do).
    seed
        Seed of the faults' random draws, or a generator. A bus without random faults draws
        nothing.
    faults
        Faults of the run; more can be added by `inject`.
    start_ns
        Time at which the bus starts (ns).
    load_window_ns
        Window of `load` (ns).
    data_bitrate
        Bits per second in the data phase of CAN FD; such a bit must last whole nanoseconds, too.
        0: a classic bus, which carries no frames of CAN FD.

    Attributes
    ----------
    bitrate, data_bitrate
        As given.
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
        data_bitrate: int = 0,
    ) -> None:
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        self.bit_ns = _bit_ns("bitrate", bitrate)
        data_bit_ns = _bit_ns("data_bitrate", data_bitrate) if data_bitrate else 0
        if data_bit_ns > self.bit_ns:
            raise ValueError(f"data_bitrate {data_bitrate}: at least the bitrate, {bitrate}")
        meter = LoadMeter(load_window_ns, start_ns)
        self._state = state = BusState(
            bit_ns=self.bit_ns,
            data_bit_ns=data_bit_ns,
            now_ns=start_ns,
            until_ns=start_ns,
            start_ns=start_ns,
            free_ns=start_ns,
            meter=meter,
        )
        self.statistics = state.statistics
        self._intermission_ns = INTERMISSION_BITS * self.bit_ns
        self._advancing = False
        self._ports: list[Port] = []
        self._frame_faults = FrameFaults(state, np.random.default_rng(seed))
        self._recovery = BusOffRecovery(state)
        self._confinement = Confinement(state, self._frame_faults, self._recovery)
        disturbance = Disturbance(state, self._confinement)
        self._injector = Injector(state, self._frame_faults, disturbance)
        for fault in () if faults is None else faults.faults:
            self._injector.add(fault)

    @property
    def now_ns(self) -> int:
        """Present time of the bus (ns)."""
        return self._state.now_ns

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
        fd: FdSupport = FdSupport.ENABLED,
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
            After bus-off, wait this long (ms) before the recovery of 128 x 11 recessive bits
            begins; None: only `Port.restart` begins it.
        listen_only
            The controller neither sends nor acknowledges.
        fd
            How the controller treats frames of CAN FD, on a bus that carries them.

        Raises
        ------
        ValueError
            If the name is taken or a limit is out of range.
        """
        bus = self._state
        if name in bus.ports:
            raise ValueError(f"port {name!r}: the name is taken on this bus")
        if queue_limit < 1 or (restart_ms is not None and restart_ms < 0):
            raise ValueError(f"port {name!r}: queue_limit {queue_limit}, restart_ms {restart_ms}")
        state = PortState(
            name=name,
            receive=receive,
            filters=None if accept is None else exact_filters(accept),
            errors=errors,
            on_sent=on_sent,
            queue_limit=queue_limit,
            restart_ns=None if restart_ms is None else restart_ms * 1_000_000,
            listen_only=listen_only,
            fd=fd,
            joining=bool(bus.senders),
        )
        bus.ports[name] = state
        self._injector.attached(state)
        bus.rewire()
        port = Port(state, bus, self._frame_faults, self._recovery)
        self._ports = [*self.ports, port]
        return port

    def tap(self, observe: Receive, *, accept: Iterable[int] | None = None) -> None:
        """Let an observer see every completed frame and every error on the wire.

        With `accept` it sees only frames of these ids (with flags), and no errors.

        It is no node: it neither acknowledges nor has error counters. Errors come as SocketCAN
        error messages of class BUSERROR, as a counter-less receiver would report them; those which
        change no node's counters (a lone error-passive node's) do not.
        """
        self._state.taps.append(Tap(observe, None if accept is None else frozenset(accept)))
        self._state.rewire()

    def inject(self, fault: Fault) -> None:
        """Add a fault to the plan; its window may have begun already."""
        self._injector.add(fault)

    @property
    def ports(self) -> tuple[Port, ...]:
        """All attached ports, in the order of their attachment."""
        return tuple(port for port in self._ports if port.attached)

    def load(self) -> float:
        """Share [0, 1] of time the bus was busy in the last window."""
        return self._state.meter.load(self._state.now_ns)

    def schedule(self, due_ns: int, action: Callable[[], None]) -> None:
        """Have `action` called when time reaches `due_ns` (at once if it has passed).

        For the timers of nodes. The action may send, attach and detach, but not advance the bus.
        It runs before a frame that is complete at the same instant.
        """
        self._state.schedule(due_ns, action)

    @property
    def next_event_ns(self) -> int | None:
        """Time of the next event if no more frames are sent; None: there is none.

        A real-time server sleeps until then, or until a frame is sent. The endless attempts of a
        lone error-passive node do not count as events.
        """
        bus = self._state
        due = bus.timer_ns
        if bus.hopeless and len(bus.senders) + len(bus.offers) == 1:
            pass
        elif bus.senders:
            due = min(bus.done_ns, due)
        elif bus.offers:
            start = self._next_start_ns()
            _, arbitration_id, data = min(port.queue[0] for port in bus.offers)
            length = frame_length(arbitration_id, data)
            due = min(due, start + bus.duration_ns(length, length.bits))
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
        bus = self._state
        if until_ns < bus.now_ns:
            raise ValueError(f"cannot go back from {bus.now_ns} ns to {until_ns} ns")
        if self._advancing:
            raise RuntimeError("Bus.advance called from within a receiver")
        self._advancing = True
        bus.until_ns = until_ns
        try:
            self._run(until_ns)
            bus.now_ns = until_ns
        finally:
            self._advancing = False

    def _run(self, until_ns: int) -> None:
        """Run timers, starts of frames and ends of frames in the order of their times."""
        bus = self._state
        timers = bus.timers
        while True:
            busy = bus.senders
            if busy:
                due_ns, last_ns = bus.done_ns, until_ns
            elif bus.offers:
                due_ns, last_ns = bus.free_ns, until_ns - 1
                if bus.slow:
                    due_ns = self._next_start_ns()
                elif due_ns < bus.now_ns:
                    due_ns = bus.now_ns
            else:
                due_ns, last_ns = NEVER_NS, until_ns
            if bus.timer_ns <= due_ns:
                if bus.timer_ns > until_ns:
                    return
                bus.now_ns, _, action = heapq.heappop(timers)
                bus.timer_ns = timers[0][0] if timers else NEVER_NS
                action()
            elif due_ns > last_ns:
                return
            else:
                bus.now_ns = due_ns
                if busy:
                    self._end_attempt(due_ns)
                else:
                    self._arbitrate(due_ns)

    def _next_start_ns(self) -> int:
        """Time at which the next of the offered frames may start."""
        bus = self._state
        ready = min(port.ready_ns for port in bus.offers)
        return max(bus.free_ns, bus.now_ns, ready)

    def _arbitrate(self, start_ns: int) -> None:
        """Let the most urgent of the offered frames start."""
        bus = self._state
        offers = bus.offers
        winner = offers[0]
        tie = False
        contested = len(offers) > 1
        if contested:
            key = winner.queue[0][0]
            for port in offers:
                other = port.queue[0][0]
                if other < key:
                    winner, key, tie = port, other, False
                elif other == key and port is not winner:
                    tie = True
        bus.start_ns = start_ns
        queue = winner.queue
        is_fd = bus.data_bit_ns and queue[0][1] > CLASSIC_MAX
        if tie or bus.slow or not winner.heard or (is_fd and bus.fd_slow):
            self._confinement.begin(start_ns)
            return
        if contested:
            for port in offers:
                port.statistics.arbitration_lost += 1
            winner.statistics.arbitration_lost -= 1
        offer = queue.popleft()
        if not queue:
            offers.remove(winner)
        bus.senders = (winner,)
        bus.offer = offer
        if is_fd:
            length = frame_length(offer[1], offer[2])
            bus.bits = length.bits
            bus.done_ns = start_ns + bus.duration_ns(length, length.bits)
        else:
            bus.bits = bits = frame_bits(offer[1], offer[2])
            bus.done_ns = start_ns + bits * self.bit_ns

    def _end_attempt(self, done_ns: int) -> None:
        """Complete the frame on the wire, or destroy it as was decided at its start."""
        bus = self._state
        if bus.failure is not None:
            self._confinement.fail()
            return
        senders = bus.senders
        sender = senders[0]
        bus.senders = ()
        bus.free_ns = free_ns = done_ns + self._intermission_ns
        _, arbitration_id, data = bus.offer
        route = sender.routes.get(arbitration_id)
        if route is None:
            route = self._route(sender, arbitration_id)
        statistics = route.statistics
        statistics.frames += 1
        statistics.bits += bus.bits + INTERMISSION_BITS
        meter = bus.meter
        meter.busy_ns += free_ns - bus.start_ns
        if done_ns >= meter.next_mark_ns:
            meter.mark(done_ns)
        # A third of the time of Frame(...), which is a function in Python.
        frame = tuple.__new__(Frame, (arbitration_id, data, done_ns))
        if bus.slow or len(senders) > 1:
            self._confinement.complete(senders, route, frame)
            return
        sender.statistics.sent += 1
        for receive in route.receivers:
            receive(frame)
        if sender.on_sent is not None:
            sender.on_sent(frame)

    def _route(self, sender: PortState, arbitration_id: int) -> Route:
        """Determine the receivers of a sender's frames of one id."""
        bus = self._state
        ports = tuple(
            port
            for port in bus.ports.values()
            if port is not sender and port.listens and port.accepts(arbitration_id)
        )
        receivers = (*bus.observers(arbitration_id), *(port.receive for port in ports))
        route = Route(receivers, ports, self.statistics.of(arbitration_id))
        if len(sender.routes) >= _MAX_ROUTES:
            sender.routes.clear()
        if len(sender.sent_ids) < _MAX_ROUTES:
            sender.sent_ids.add(arbitration_id)
        sender.routes[arbitration_id] = route
        return route


def _bit_ns(name: str, bitrate: int) -> int:
    """Return the length of a bit (ns)."""
    if bitrate <= 0 or 1_000_000_000 % bitrate:
        raise ValueError(f"{name} {bitrate}: a bit must last whole nanoseconds")
    return 1_000_000_000 // bitrate
