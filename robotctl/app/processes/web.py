"""The web process: the page for people."""

from __future__ import annotations

import asyncio
import gc
import math
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import uvicorn
import zmq

import robotctl
from robotctl.app.processes.entry import enter
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import LinkError
from robotctl.planning.guard.obstacle_guard import body_rectangle
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import (
    Endpoints,
    RawSubscriber,
    RequestSender,
    endpoint_directory,
)
from robotctl.web.access import Access
from robotctl.web.config import WebConfig
from robotctl.web.desk import Desk, Now
from robotctl.web.links import WebLinks, read_links, write_links
from robotctl.web.server import MAX_MESSAGE_BYTES, PageServer, RobotSide
from robotctl.web.wire import RobotOutline, SonarOutline

PERIOD_S: Final = 0.02
"""Period at which published messages are taken [s]."""
_PORTS: Final = 100
"""Ports that are tried, from the configured one on."""
_ARM_NS: Final = 1_000_000_000
"""Time for control's answer after it has given up arming [ns]."""
_SENT_BYTES: Final = 64 * 1024
"""Buffer of the kernel for a client, which it doubles: pictures that lie there are late."""


def outline_of(config: RobotConfig, *, simulated: bool) -> RobotOutline:
    """Return what the page needs to know of a robot before any message."""
    body = body_rectangle(config.navigation.guard, config.sonar)
    rear_m, front_m, half_m = body
    limits = config.limits
    return RobotOutline(
        name=config.robot.name,
        version=robotctl.__version__,
        simulated=simulated,
        drive=config.drive.kind,
        holonomic=config.drive.holonomic,
        has_lidar=config.lidar is not None,
        has_localiser=config.localisation.method != "none",
        outline=((front_m, -half_m), (front_m, half_m), (rear_m, half_m), (rear_m, -half_m)),
        sonars=tuple(
            SonarOutline(each.name, each.x_m, each.y_m, math.radians(each.heading_deg))
            for each in config.sonar
        ),
        v_max_m_s=limits.v_max_m_s,
        omega_max_rad_s=limits.omega_max_rad_s,
        vy_max_m_s=limits.vy_max_m_s,
    )


def listen(config: WebConfig, before: WebLinks | None) -> tuple[socket.socket, tuple[str, ...]]:
    """Return a listening socket at the configured port, or the next free one, and remarks.

    Parameters
    ----------
    config
        The address.
    before
        Links of this process's previous life, whose port is tried first.

    Raises
    ------
    LinkError
        If there is no free one.
    """
    host = "127.0.0.1" if config.host == "localhost" else config.host
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    ports = [config.port, *range(config.port + 1, min(config.port + _PORTS, 65536))]
    ports = ports if config.port else [0]
    for port in ports if before is None else [before.port, *ports]:
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SENT_BYTES)
        try:
            listener.bind((host, port))
            listener.listen(64)
        except OSError as error:
            listener.close()
            last = error
            continue
        found = listener.getsockname()[1]
        taken = config.port not in (0, found)
        return listener, (f"port {config.port} is taken, so it is {found}",) * taken
    raise LinkError(
        f"web: no page at {config.host}, ports {ports[0]} to {ports[-1]}: {last.strerror}"
    )


class _Server(uvicorn.Server):
    """Server whose process takes signals itself."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone."""
        yield


async def _serve(
    page: PageServer,
    listener: socket.socket,
    states: RawSubscriber,
    truths: RawSubscriber | None,
    stopped: StopFlag,
    heartbeat: ProcessHeartbeat,
) -> None:
    """Serve until asked to end."""
    server = _Server(
        uvicorn.Config(
            page.app,
            http="h11",
            ws="websockets-sansio",
            ws_max_size=MAX_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=5.0,
            ws_ping_timeout=10.0,
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            date_header=False,
            proxy_headers=False,
            timeout_graceful_shutdown=1,
        )
    )
    serving = asyncio.create_task(server.serve([listener]))
    deadline_s = time.monotonic()
    while not stopped() and not serving.done():
        page.relay(states.receive(), [] if truths is None else truths.receive())
        heartbeat.beat()
        deadline_s = max(deadline_s + PERIOD_S, time.monotonic())
        await asyncio.sleep(deadline_s - time.monotonic())
    server.should_exit = True
    await serving


def run(config: RobotConfig, options: StackOptions) -> None:
    """Serve the page until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    listener, remarks = listen(config.web, read_links(endpoints.web_links))
    port = listener.getsockname()[1]
    access = Access({}, config.web.allowed_hosts, port)
    link = f"http://{config.web.host}:{port}/"
    write_links(endpoints.web_links, WebLinks(link, link, port, remarks=remarks))
    context: zmq.Context[Any] = zmq.Context()
    states = RawSubscriber(context, (*endpoints.published, endpoints.supervisor_notices))
    simulated = Path(endpoints.truth.removeprefix("ipc://")).exists()
    truths = RawSubscriber(context, (endpoints.truth,)) if simulated else None
    to_control = RequestSender(context, endpoints.control_requests)
    to_navigation = RequestSender(context, endpoints.navigation_requests)
    heartbeat = ProcessHeartbeat(os.environ)
    robot = RobotSide(
        outline_of(config, simulated=simulated),
        lambda: Now(time.monotonic_ns(), clock.now_ns()),
        to_control.send,
        to_navigation.send,
    )
    desk = Desk(
        has_localiser=config.localisation.method != "none",
        arm_timeout_ns=config.safety.arm_timeout_ms * 1_000_000 + _ARM_NS,
    )
    static = Path(robotctl.__file__).parent / "web" / "static"
    page = PageServer(robot, desk, access, static)
    gc.collect()
    gc.freeze()
    try:
        asyncio.run(_serve(page, listener, states, truths, stopped, heartbeat))
    finally:
        context.destroy(linger=0)


if __name__ == "__main__":
    sys.exit(enter("web", run))
