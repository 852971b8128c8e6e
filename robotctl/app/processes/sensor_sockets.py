"""Sockets and heartbeat of a sensor's process."""

from __future__ import annotations

import os

import zmq

from robotctl.messages.control import ControlState, Notice
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import Endpoints, Publisher, Subscriber


class SensorSockets:
    """Sockets and heartbeat of one process; use as a context manager.

    Parameters
    ----------
    endpoints
        Of the robot.
    own
        Where the process publishes.

    Attributes
    ----------
    context
        For sockets that only one kind of sensor has.
    publisher
        To all who listen.
    """

    def __init__(self, endpoints: Endpoints, own: str) -> None:
        self.context = zmq.Context()
        self.publisher = Publisher(self.context, own)
        self._states = Subscriber[ControlState | Notice](
            self.context, (endpoints.control_state,), ControlState | Notice
        )
        self._heartbeat = ProcessHeartbeat(os.environ)

    def beat(self) -> None:
        """Send the supervisor a heartbeat."""
        self._heartbeat.beat()

    def states(self) -> list[ControlState]:
        """Return the control states since the last call: poses over time."""
        return [each for each in self._states.receive() if isinstance(each, ControlState)]

    def __enter__(self) -> SensorSockets:
        return self

    def __exit__(self, *_error: object) -> None:
        self.context.destroy(linger=0)
