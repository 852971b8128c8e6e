"""The supervisor's sockets: its notices for ground stations and logs, and requests to it."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import zmq

from robotctl.messages.control import Notice, Severity
from robotctl.messages.supervision import SupervisorRequest
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestReceiver,
    endpoint_directory,
)

_KEPT_NS: Final = 10_000_000_000
"""Time for which notices are kept for new subscribers, mainly the restarted process [ns]."""


class Announcer:
    """Publishes notices of the supervisor and takes requests, once open.

    Parameters
    ----------
    instance
        Name of the robot.
    """

    def __init__(self, instance: str) -> None:
        self._instance = instance
        self._context: zmq.Context[Any] | None = None
        self._publisher: Publisher | None = None
        self._requests: RequestReceiver[SupervisorRequest] | None = None
        self._kept: deque[Notice] = deque(maxlen=32)

    def open(self) -> None:
        """Begin to publish, once this supervisor is known to be the only one of the robot."""
        if self._publisher is None:
            self._context = zmq.Context()
            endpoints = Endpoints(endpoint_directory(self._instance))
            self._publisher = Publisher(self._context, endpoints.supervisor_notices)
            self._requests = RequestReceiver(
                self._context, endpoints.supervisor_requests, SupervisorRequest
            )
            self._greet()

    def say(self, text: str, severity: Severity, now_ns: int) -> None:
        """Publish a notice to present subscribers and those of the next seconds."""
        notice = Notice(now_ns, severity, text)
        if self._publisher is not None:
            self._publisher.send(notice)
        self._kept.append(notice)
        self._greet()

    def take_requests(self) -> list[SupervisorRequest]:
        """Return the requests since the last call, oldest first."""
        return [] if self._requests is None else self._requests.receive()

    def step(self, now_ns: int) -> None:
        """Greet new subscribers; drop old notices."""
        if self._publisher is not None:
            self._publisher.attend()
        if self._kept and now_ns - self._kept[0].stamp_ns > _KEPT_NS:
            self._kept.popleft()
            self._greet()

    def _greet(self) -> None:
        """Send the kept notices, as one, to each new subscriber."""
        if self._publisher is None:
            return
        if not self._kept:
            self._publisher.greet(None)
            return
        severity = min(each.severity for each in self._kept)
        text = "\n".join(each.text for each in self._kept)
        self._publisher.greet(Notice(self._kept[-1].stamp_ns, severity, text))

    def close(self) -> None:
        """Close the sockets."""
        if self._publisher is not None and self._context is not None:
            self._publisher.close()
            self._context.destroy(linger=100)
            self._publisher = self._context = self._requests = None
