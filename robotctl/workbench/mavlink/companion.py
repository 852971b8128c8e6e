"""A program that talks to one robot over a MAVLink link of its own."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from pymavlink.dialects.v20 import common

from robotctl.errors import LinkError
from robotctl.messages.mavlink_port import MavlinkPort, Message, Peer, Received, source

SYSTEM, COMPONENT = 254, 190
"""Ids of the program: it is no ground station, so its end stops no robot."""
BEAT_S: Final = 1.0
POLL_S: Final = 0.05
FIND_S: Final = 10.0
"""A robot has this long to be heard [s], where nothing says that it is not there."""
REFUSED_S: Final = 0.8
"""Attempts to reach it fail for this long before that is believed [s]."""


class Companion:
    """A link, with a heartbeat once a second, and the robot at its other end.

    Parameters
    ----------
    links
        Of one link; the caller closes them.
    url
        Of it, for messages.
    clock_s
        Returns the time [s].
    """

    def __init__(
        self, links: MavlinkPort, url: str, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._links = links
        self._url = url
        self._clock_s = clock_s
        self._beat_s = -BEAT_S
        self._robot: tuple[int, int] | None = None
        self._peer: Peer | None = None
        self.is_ardupilot = True
        """Whether the robot claims to be of ArduPilot, which packs parameters in its own way."""
        self._heard: deque[Message] = deque()
        """Messages that have come and were not taken yet."""
        self.texts: list[str] = []
        """STATUSTEXT of the robot since the last request."""

    @property
    def now_s(self) -> float:
        """The time [s]."""
        return self._clock_s()

    def poll(self) -> Sequence[Received]:
        """Return what has come within a moment."""
        now_s = self._clock_s()
        if now_s - self._beat_s >= BEAT_S:
            self._beat_s = now_s
            beat = common.MAVLink_heartbeat_message(
                common.MAV_TYPE_ONBOARD_CONTROLLER, common.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3
            )
            self._links.broadcast(beat)
        self._links.flush()
        return self._links.poll(round(now_s * 1e9), POLL_S)

    def find(self) -> None:
        """Wait for a robot.

        Raises
        ------
        LinkError
            If none is heard, or its port cannot be reached.
        """
        start_s = self._clock_s()
        while self._clock_s() < start_s + FIND_S:
            (status,) = self._links.status()
            is_refused = status.last_error and not status.received
            if is_refused and self._clock_s() >= start_s + REFUSED_S:
                raise self._not_found(f"no robot is there, {status.last_error}")
            for message, peer in self.poll():
                is_beat = message.get_msgId() == common.MAVLINK_MSG_ID_HEARTBEAT
                if is_beat and message.autopilot != common.MAV_AUTOPILOT_INVALID:
                    self._robot, self._peer = source(message), peer
                    self.is_ardupilot = message.autopilot == common.MAV_AUTOPILOT_ARDUPILOTMEGA
                    return
        raise self._not_found(f"no robot is heard within {FIND_S:g} s")

    def _not_found(self, found: str) -> LinkError:
        """Return the error of a link without a robot."""
        return LinkError(
            f"{self._url}: {found}; --link URL says where a robot is that runs, as a "
            "[[mavlink.link]] of its file does: a tcpin there is a tcpout here"
        )

    def hear(self, seconds: float) -> Iterator[Message]:
        """Yield the robot's messages of the coming time [s]."""
        end_s = self._clock_s() + seconds
        while self._clock_s() < end_s:
            self._heard.extend(each.message for each in self.poll())
            while self._heard:
                message = self._heard.popleft()
                if source(message) == self._robot:
                    self._note(message)
                    yield message

    def _note(self, message: Message) -> None:
        """Keep a text; long ones come in parts."""
        if message.get_msgId() != common.MAVLINK_MSG_ID_STATUSTEXT:
            return
        if message.id and message.chunk_seq and self.texts:
            self.texts[-1] += message.text
        else:
            self.texts.append(message.text)

    def send(self, make: Callable[[int, int], Message]) -> None:
        """Send the message made for the robot's system and component."""
        if self._robot is not None and self._peer is not None:
            self._links.reply(make(*self._robot), self._peer)
            self._links.flush()
