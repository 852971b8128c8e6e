"""Periodic messages: each at its own rate for each peer.

SET_MESSAGE_INTERVAL changes one, the older REQUEST_DATA_STREAM those of a group, as ArduPilot has
them, or of all groups. A rate that a peer has asked for holds for that peer alone, and ends with
it: when its connection is closed, its port is, or nothing has come from it for `SILENT_NS`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from heapq import heapify, heapreplace
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Catalogue, Stream
from robotctl.mavlink.command import ACCEPTED, DENIED, Command
from robotctl.mavlink.config import MAX_RATE_HZ
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice
from robotctl.mavlink.services.telemetry.heartbeat import INTERVAL_NS as BEAT_NS
from robotctl.messages.mavlink_port import Message, Peer

SET_INTERVAL: int = common.MAV_CMD_SET_MESSAGE_INTERVAL
HIGH_LATENCY: int = common.MAV_CMD_CONTROL_HIGH_LATENCY
GET_INTERVAL: int = common.MAV_CMD_GET_MESSAGE_INTERVAL
MAX_INTERVAL_US = 0x7FFF_FFFF
"""MESSAGE_INTERVAL carries a signed 32 bit number [us]: 36 minutes at most."""

SILENT_NS: Final = 10_000_000_000
"""A peer that has been silent for longer has gone [ns]; ground stations send every second."""

OFF = -1
HIGH_LATENCY_NS: Final = 5_000_000_000
"""Interval of HIGH_LATENCY2, where it is asked for by its own command [ns]."""
SHORTEST_NS = round(1e9 / MAX_RATE_HZ)
PHASE_NS = 20_000_000
"""Offset between the starts of two streams [ns], so that they do not fall into one step."""


@dataclass(slots=True)
class _Rate:
    """Interval of one stream to one peer, and when it is due [ns]."""

    interval_ns: int
    due_ns: int

    def follow(self, now_ns: int, stretch: float) -> None:
        """Note when it is due next; a late step does not cause a burst.

        `stretch` is how many times longer the interval is while the link has no room.
        """
        interval_ns = round(self.interval_ns * stretch)
        following = self.due_ns + interval_ns
        self.due_ns = following if following > now_ns else now_ns + interval_ns


@dataclass(slots=True)
class _Plan:
    """Plan for one peer: the rates by message, and whether it has asked for other ones.

    Those that outlast silence hold though nothing comes from it.
    """

    rates: dict[int, _Rate] = field(default_factory=dict)
    is_asked_for: bool = False
    outlasts_silence: bool = False
    queue: list[tuple[int, int]] | None = None
    """Due time [ns] and number of each message, the earliest first; None: rates have changed."""

    def change(self, message_id: int, interval_ns: int, due_ns: int) -> None:
        """Send a message at another rate."""
        self.rates[message_id] = _Rate(interval_ns, due_ns)
        self.queue = None

    def take(self, now_ns: int, stretch: float) -> list[int]:
        """Return which messages are due, each once; `stretch` as for a rate."""
        if self.queue is None:
            self.queue = [(r.due_ns, key) for key, r in self.rates.items() if r.interval_ns != OFF]
            heapify(self.queue)
        due = []
        while self.queue and self.queue[0][0] <= now_ns:
            message_id = self.queue[0][1]
            rate = self.rates[message_id]
            rate.follow(now_ns, stretch)
            heapreplace(self.queue, (rate.due_ns, message_id))
            due.append(message_id)
        return due


class Streams(Microservice):
    """Sends the streams of all services; a peer may change its own rates."""

    handles = frozenset({common.MAVLINK_MSG_ID_REQUEST_DATA_STREAM})
    commands = frozenset({SET_INTERVAL, GET_INTERVAL, HIGH_LATENCY})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._plans: dict[Peer, _Plan] = {}
        self._known: Catalogue | None = None
        """With the configured rates."""
        context.receivers = self.receivers

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take REQUEST_DATA_STREAM, which has no answer."""
        rate_hz = message.req_message_rate
        is_off = not message.start_stop or not rate_hz
        interval_ns = OFF if is_off else max(round(1e9 / rate_hz), SHORTEST_NS)
        plan, streams = self._plan(peer, now_ns), self._context.catalogue.streams
        first_ns = now_ns
        for message_id, rate in list(plan.rates.items()):
            group = streams[message_id].group
            is_wanted = message.req_stream_id in (group, common.MAV_DATA_STREAM_ALL)
            # One that repeats its request, as many do, gets no more for it.
            if group is not None and is_wanted and rate.interval_ns != interval_ns:
                plan.change(message_id, interval_ns, first_ns)
                plan.is_asked_for = True
                first_ns += PHASE_NS

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take SET_ and GET_MESSAGE_INTERVAL; DENIED where the message is not ours to send.

        CONTROL_HIGH_LATENCY: param1 1 leaves its sender HIGH_LATENCY2 alone, beside heartbeats.
        """
        if command.number == HIGH_LATENCY:
            return self._high_latency(command, now_ns)
        message_id = command.whole(0)
        if message_id is None:
            return DENIED
        if command.number == GET_INTERVAL:
            return self._tell_interval(message_id, command, now_ns)
        return self._set_interval(message_id, command, now_ns)

    def _high_latency(self, command: Command, now_ns: int) -> int:
        """Send a peer one small message, or what all others get again."""
        if command.params[0] not in {0.0, 1.0}:
            return DENIED
        self._plans.pop(command.peer, None)
        if command.params[0] == 1.0:
            plan = self._plan(command.peer, now_ns)
            for message_id in plan.rates:
                is_it = message_id == common.MAVLINK_MSG_ID_HIGH_LATENCY2
                plan.change(message_id, HIGH_LATENCY_NS if is_it else OFF, now_ns)
            plan.is_asked_for = plan.outlasts_silence = True
        return ACCEPTED

    def _set_interval(self, message_id: int, command: Command, now_ns: int) -> int:
        """Change the interval for the sender: 0 is the default, -1 is off.

        HEARTBEAT has one rate, because others judge the robot by it.
        """
        interval_us = command.params[1]
        if message_id == common.MAVLINK_MSG_ID_HEARTBEAT:
            return ACCEPTED if interval_us in (0.0, BEAT_NS / 1e3) else DENIED
        plan = self._plan(command.peer, now_ns)
        if message_id not in plan.rates or not -1.0 <= interval_us <= MAX_INTERVAL_US:
            return DENIED
        interval_ns = max(math.ceil(interval_us * 1000.0), SHORTEST_NS)
        if interval_us < 0.0:
            interval_ns = OFF
        elif interval_us == 0.0:
            interval_ns = self._default_ns(self._context.catalogue.streams[message_id])
        plan.change(message_id, interval_ns, now_ns)
        plan.is_asked_for = True
        return ACCEPTED

    def _tell_interval(self, message_id: int, command: Command, now_ns: int) -> int:
        """Answer with MESSAGE_INTERVAL [us]: 0 is not available, -1 is off."""
        if not 0 <= message_id <= 0xFFFF:
            return DENIED
        rate = self._plan(command.peer, now_ns).rates.get(message_id)
        interval_us = 0
        if message_id == common.MAVLINK_MSG_ID_HEARTBEAT:
            interval_us = BEAT_NS // 1000
        elif rate is not None:
            interval_us = OFF if rate.interval_ns == OFF else rate.interval_ns // 1000
        elif message_id in self._context.catalogue.streams:
            interval_us = OFF
        answer = common.MAVLink_message_interval_message(message_id, interval_us)
        self._context.links.reply(answer, command.peer)
        return ACCEPTED

    def step(self, now_ns: int) -> None:
        """Send due messages, each made once for all peers that get it now."""
        peers, stretch = self._context.peers, self._context.stretch
        self._forget(now_ns)
        self._take_defaults(now_ns)
        due: dict[int, list[Peer]] = {}
        for peer in peers:
            for message_id in self._plan(peer, now_ns).take(now_ns, stretch.get(peer.link, 1.0)):
                due.setdefault(message_id, []).append(peer)
        for message_id, wanting in due.items():
            for message in self._context.catalogue.streams[message_id].build(now_ns):
                self._context.links.broadcast(message, wanting)

    def _take_defaults(self, now_ns: int) -> None:
        """Give whoever gets a message at its configured rate the new one, where that changed."""
        before, self._known = self._known, self._context.catalogue
        if before is None or before is self._known:
            return
        for plan in self._plans.values():
            for key, rate in plan.rates.items():
                old_ns, new_ns = (
                    self._default_ns(each.streams[key])
                    for each in (before, self._context.catalogue)
                )
                if new_ns != old_ns == rate.interval_ns:
                    plan.change(key, new_ns, now_ns)

    def _forget(self, now_ns: int) -> None:
        """Drop the plans of peers that have gone."""
        context = self._context
        for peer, plan in list(self._plans.items()):
            silent_ns = now_ns - context.heard_ns.get(peer, 0)
            ends = plan.is_asked_for and not plan.outlasts_silence and silent_ns > SILENT_NS
            if ends or peer not in context.peers:
                del self._plans[peer]

    def _plan(self, peer: Peer, now_ns: int) -> _Plan:
        """Return what a peer gets; a new one the default rates."""
        plan = self._plans.get(peer)
        if plan is None:
            streams = self._context.catalogue.streams.values()
            periodic = [stream for stream in streams if stream.rate_hz is not None]
            plan = self._plans[peer] = _Plan()
            first_ns = now_ns
            for stream in periodic:
                interval_ns = self._default_ns(stream)
                plan.change(stream.message_id, interval_ns, first_ns)
                first_ns += 0 if interval_ns == OFF else PHASE_NS
        return plan

    def _default_ns(self, stream: Stream) -> int:
        """Return the interval of a periodic stream to who has not asked for another [ns]."""
        is_unknown = stream.message_id in self._context.personality.unknown
        return OFF if is_unknown or not stream.rate_hz else round(1e9 / stream.rate_hz)

    def receivers(self, message_id: int) -> list[Peer]:
        """Return who gets a periodic message, at whatever rate."""
        default_ns = self._default_ns(self._context.catalogue.streams[message_id])
        plans = {peer: self._plans.get(peer) for peer in self._context.peers}
        return [
            peer
            for peer, plan in plans.items()
            if (default_ns if plan is None else plan.rates[message_id].interval_ns) != OFF
        ]
