"""Periodic messages: each at its own rate on each link."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from pymavlink.dialects.v20 import common

from robotctl.mavlink.config import MAX_RATE_HZ
from robotctl.mavlink.service import Context
from robotctl.mavlink.services import stream_messages
from robotctl.messages.mavlink_port import Message, Peer

OFF = -1
SHORTEST_NS = round(1e9 / MAX_RATE_HZ)
PHASE_NS = 20_000_000
"""The streams start one after the other by this [ns], so that they do not fall into one step."""

Builder: TypeAlias = Callable[[int], list[Message]]


class Streams:
    """Sends the periodic messages; ground stations may change their rates on their own link."""

    handles: frozenset[int] = frozenset()

    def __init__(self, context: Context) -> None:
        self._context = context
        self._epoch: tuple[int, int] | None = None
        self._resets = 0
        rates = context.config.rates
        defaults: dict[int, tuple[float, Builder]] = {
            common.MAVLINK_MSG_ID_ATTITUDE: (rates.attitude_hz, self._attitude),
            common.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (rates.position_hz, self._position),
            common.MAVLINK_MSG_ID_ODOMETRY: (rates.odometry_hz, self._odometry),
            common.MAVLINK_MSG_ID_WHEEL_DISTANCE: (rates.wheel_distance_hz, self._wheels),
            common.MAVLINK_MSG_ID_DISTANCE_SENSOR: (rates.sonar_hz, self._sonars),
            common.MAVLINK_MSG_ID_BATTERY_STATUS: (rates.battery_hz, self._battery),
            common.MAVLINK_MSG_ID_SYS_STATUS: (rates.status_hz, self._status),
        }
        self.builders: dict[int, Builder] = {
            message_id: builder for message_id, (_, builder) in defaults.items()
        }
        self._defaults_ns = {
            message_id: round(1e9 / rate_hz) if rate_hz > 0.0 else OFF
            for message_id, (rate_hz, _) in defaults.items()
        }
        links = range(context.links.count)
        self._intervals = {
            key: [interval for _ in links] for key, interval in self._defaults_ns.items()
        }
        self._due: dict[int, list[int]] | None = None

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take nothing."""

    def interval_ns(self, message_id: int, link: int) -> int | None:
        """Return the interval on `link` [ns], OFF, or None where there is no such stream."""
        intervals = self._intervals.get(message_id)
        return None if intervals is None else intervals[link]

    def set_interval(self, message_id: int, link: int, interval_ns: int, now_ns: int) -> bool:
        """Change the interval on one link [ns]: 0 is the default, negative is off.

        Intervals below 10 ms are raised to it. False where there is no such stream.
        """
        if message_id not in self._intervals:
            return False
        if interval_ns == 0:
            interval_ns = self._defaults_ns[message_id]
        elif interval_ns > 0:
            interval_ns = max(interval_ns, SHORTEST_NS)
        self._intervals[message_id][link] = interval_ns if interval_ns > 0 else OFF
        self._due_table(now_ns)[message_id][link] = now_ns
        return True

    def step(self, now_ns: int) -> None:
        """Send what is due; a late step does not lead to a burst."""
        self._count_resets()
        for message_id, due in self._due_table(now_ns).items():
            intervals = self._intervals[message_id]
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
            for message in self.builders[message_id](now_ns):
                self._context.links.broadcast(message, links)

    def _due_table(self, now_ns: int) -> dict[int, list[int]]:
        if self._due is None:
            links = range(self._context.links.count)
            self._due = {
                message_id: [now_ns + phase * PHASE_NS for _ in links]
                for phase, message_id in enumerate(self._intervals)
            }
        return self._due

    def _count_resets(self) -> None:
        """Count the jumps of the pose in `world`."""
        control, world = self._context.control, self._context.world
        if control is not None and world.pose(control) is not None:
            epoch = world.epoch(control)
            self._resets += self._epoch not in {None, epoch}
            self._epoch = epoch

    def _attitude(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        return [] if found is None else stream_messages.attitude(*found)

    def _position(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        return [] if found is None else stream_messages.local_position(*found)

    def _odometry(self, now_ns: int) -> list[Message]:
        found = self._context.fresh_pose(now_ns)
        if found is None:
            return []
        return stream_messages.odometry(*found, self._context.fresh_fix(now_ns), self._resets)

    def _wheels(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None else stream_messages.wheel_distance(control)

    def _sonars(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        robot = self._context.robot
        return [] if control is None else stream_messages.distance_sensors(control, robot)

    def _battery(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return [] if control is None else stream_messages.battery_status(control)

    def _status(self, now_ns: int) -> list[Message]:
        control = self._context.fresh_control(now_ns)
        return stream_messages.system_status(control, self._context.robot)
