"""Periodic messages: each at its own rate on each link."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import common

from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.command import ACCEPTED, DENIED, Command
from robotctl.mavlink.config import MAX_RATE_HZ
from robotctl.mavlink.context import Context
from robotctl.mavlink.service import Microservice

SET_INTERVAL: int = common.MAV_CMD_SET_MESSAGE_INTERVAL
GET_INTERVAL: int = common.MAV_CMD_GET_MESSAGE_INTERVAL
MAX_INTERVAL_US = 0x7FFF_FFFF
"""MESSAGE_INTERVAL carries a signed 32 bit number [us]: 36 minutes at most."""

OFF = -1
SHORTEST_NS = round(1e9 / MAX_RATE_HZ)
PHASE_NS = 20_000_000
"""The streams start one after the other by this [ns], so that they do not fall into one step."""


@dataclass(frozen=True, slots=True)
class _Plan:
    """When one stream is due; the lists are by link [ns]."""

    stream: Stream
    default_ns: int
    interval_ns: list[int]
    due_ns: list[int]


class Streams(Microservice):
    """Sends the streams of all services; ground stations may change the rates on their own link."""

    commands = frozenset({SET_INTERVAL, GET_INTERVAL})

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._plans: dict[int, _Plan] = {}

    def on_command(self, command: Command, now_ns: int) -> int:
        """Take SET_ and GET_MESSAGE_INTERVAL; DENIED where the message is not ours to send."""
        message_id = command.whole(0)
        if message_id is None:
            return DENIED
        plan = self._planned(now_ns).get(message_id)
        if command.number == GET_INTERVAL:
            return self._tell_interval(message_id, plan, command)
        if plan is None:
            return DENIED
        return self._set_interval(plan, command, now_ns)

    def _set_interval(self, plan: _Plan, command: Command, now_ns: int) -> int:
        """Change the interval on the link of `command`: 0 is the default, -1 is off."""
        interval_us, link = command.params[1], command.peer.link
        if not -1.0 <= interval_us <= MAX_INTERVAL_US:
            return DENIED
        if interval_us < 0.0:
            plan.interval_ns[link] = OFF
        elif interval_us == 0.0:
            plan.interval_ns[link] = plan.default_ns
        else:
            plan.interval_ns[link] = max(math.ceil(interval_us * 1000.0), SHORTEST_NS)
        plan.due_ns[link] = now_ns
        return ACCEPTED

    def _tell_interval(self, message_id: int, plan: _Plan | None, command: Command) -> int:
        """Answer with MESSAGE_INTERVAL [us]: 0 is no periodic message, -1 is off."""
        if not 0 <= message_id <= 0xFFFF:
            return DENIED
        interval_us = 0
        if plan is not None:
            interval_ns = plan.interval_ns[command.peer.link]
            interval_us = OFF if interval_ns == OFF else interval_ns // 1000
        answer = common.MAVLink_message_interval_message(message_id, interval_us)
        self._context.links.reply(answer, command.peer)
        return ACCEPTED

    def step(self, now_ns: int) -> None:
        """Send due messages; a late step does not cause a burst."""
        for plan in self._planned(now_ns).values():
            due, intervals = plan.due_ns, plan.interval_ns
            links = [
                link
                for link, due_ns in enumerate(due)
                if now_ns >= due_ns and intervals[link] != OFF
            ]
            if not links:
                continue
            for link in links:
                following = due[link] + intervals[link]
                due[link] = following if following > now_ns else now_ns + intervals[link]
            for message in plan.stream.build(now_ns):
                self._context.links.broadcast(message, links)

    def _planned(self, now_ns: int) -> dict[int, _Plan]:
        """Return the plan of each stream, made when it is first asked for."""
        if not self._plans:
            links = self._context.links.count
            for stream in self._context.catalogue.streams.values():
                if stream.rate_hz is not None:
                    default_ns = round(1e9 / stream.rate_hz) if stream.rate_hz > 0.0 else OFF
                    first_ns = now_ns + len(self._plans) * PHASE_NS
                    plan = _Plan(stream, default_ns, [default_ns] * links, [first_ns] * links)
                    self._plans[stream.message_id] = plan
        return self._plans
