"""The Foxglove process: lets viewers watch the robot live.

It is a process of its own, so that who looks costs the page and the robot nothing but its time.
"""

from __future__ import annotations

import gc
import os
import sys
from typing import Any, Final

import zmq

from robotctl.app.processes.entry import enter
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.logs.logs import scene_of
from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.live import LiveTopics
from robotctl.messages.control import Notice, Severity
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import Endpoints, Publisher, Subscriber, endpoint_directory

WATCHED_NS: Final = 40_000_000
IDLE_NS: Final = 200_000_000
"""Periods of taking published messages, with and without viewers [ns]."""


def run(config: RobotConfig, options: StackOptions) -> None:
    """Serve viewers until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    host = "127.0.0.1" if config.web.host == "localhost" else config.web.host
    topics = LiveTopics(host, options.epoch_ns, config.robot.name, scene_of(config))
    context: zmq.Context[Any] = zmq.Context()
    heard = (*endpoints.published, endpoints.supervisor_notices)
    messages = Subscriber[Published](context, heard, Published)
    publisher = Publisher(context, endpoints.foxglove_notices)
    address = f"[{host}]" if ":" in host else host
    told = f"Foxglove: ws://{address}:{topics.port}"
    publisher.greet(Notice(clock.now_ns(), Severity.NOTICE, told))
    heartbeat = ProcessHeartbeat(os.environ)
    gc.collect()
    gc.freeze()
    try:
        while not stopped():
            for message in messages.receive():
                topics.show(message)
            topics.greet()
            publisher.attend()
            heartbeat.beat()
            period_ns = WATCHED_NS if topics.is_watched else IDLE_NS
            clock.sleep_until(clock.now_ns() + period_ns)
    finally:
        topics.close()
        context.destroy(linger=0)


if __name__ == "__main__":
    sys.exit(enter("foxglove", run))
