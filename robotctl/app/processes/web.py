"""The web process: the page for people."""

from __future__ import annotations

import asyncio
import gc
import math
import os
import socket
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import zmq

import robotctl
from robotctl.app.processes.computer import Computer
from robotctl.app.processes.entry import enter
from robotctl.app.processes.plan_files import plan_stores
from robotctl.app.processes.recordings import RecordingFolder
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.file_writing import ParameterWriter
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.messages.control import Notice, Severity
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RawSubscriber,
    RequestSender,
    endpoint_directory,
)
from robotctl.web.access import Access, Role
from robotctl.web.config import LOOPBACK_NAMES, WebConfig
from robotctl.web.desk import Desk
from robotctl.web.links import WebLinks, read_links, write_links
from robotctl.web.listening import PageHost, address_towards_others, listen
from robotctl.web.recordings import RecordingPages
from robotctl.web.robot_side import PictureSource, RobotSide
from robotctl.web.robot_view import Now
from robotctl.web.secret_files import certificate_of, fingerprint_of, tokens_of
from robotctl.web.server import PageServer
from robotctl.web.wire import RobotOutline, SonarOutline

_ARM_NS: Final = 1_000_000_000
"""Time for control's answer after it has given up arming [ns]."""


def outline_of(config: RobotConfig, *, simulated: bool, file: str = "") -> RobotOutline:
    """Return what the page needs to know of a robot before any message; `file` may be written."""
    limits = config.limits
    return RobotOutline(
        name=config.robot.name,
        version=robotctl.__version__,
        simulated=simulated,
        drive=config.drive.kind,
        holonomic=config.drive.holonomic,
        has_lidar=bool(config.lidars),
        has_localiser=config.localisation.method != "none",
        bodies=tuple(each.outlines for each in config.footprints),
        sonars=tuple(
            SonarOutline(each.name, each.x_m, each.y_m, math.radians(each.heading_deg))
            for each in config.sonar
        ),
        v_max_m_s=limits.v_max_m_s,
        omega_max_rad_s=limits.omega_max_rad_s,
        vy_max_m_s=limits.vy_max_m_s,
        wheels=config.drive.wheel_names,
        file=file,
    )


@dataclass(frozen=True, slots=True)
class Secrets:
    """Secrets of the page: tokens and a certificate.

    Parameters
    ----------
    tokens
        Of each role; empty: none are needed.
    certificate, key
        Files for TLS; None: plain HTTP.
    """

    tokens: Mapping[Role, str]
    certificate: Path | None = None
    key: Path | None = None


def secrets_of(config: WebConfig, state: Path) -> Secrets:
    """Return the secrets of a page, made where they are missing.

    Raises
    ------
    DiskError
        If they cannot be kept, or a given certificate is none.
    """
    tokens = {} if config.is_loopback else tokens_of(state)
    if not config.tls:
        return Secrets(tokens)
    if config.certificate:
        return Secrets(tokens, Path(config.certificate), Path(config.key))
    names = {*LOOPBACK_NAMES, address_towards_others(config.host), *config.allowed_hosts}
    own = certificate_of(state, sorted({*names, socket.gethostname()}))
    return Secrets(tokens, own, own)


def links_of(config: WebConfig, secrets: Secrets, port: int) -> WebLinks:
    """Return the links of a page that is served at `port`."""
    host = address_towards_others(config.host)
    host = f"[{host}]" if ":" in host else host
    base = f"{'https' if config.tls else 'http'}://{host}:{port}/"
    links = {role: f"{base}#token={token}" for role, token in secrets.tokens.items()}
    remarks = []
    if config.port not in (0, port):
        remarks.append(f"port {config.port} is taken, so it is {port}")
    if not config.is_loopback:
        remarks.append("whoever has this link may drive the robot; `robotctl web` has one to look")
        if not config.tls:
            remarks.append(
                "it is not encrypted: who listens on this network reads it; web.tls = true encrypts"
            )
    drive, look = links.get(Role.DRIVE, base), links.get(Role.LOOK, base)
    return WebLinks(
        drive=drive,
        look=look,
        port=port,
        is_remote=not config.is_loopback,
        fingerprint="" if secrets.certificate is None else fingerprint_of(secrets.certificate),
        remarks=tuple(remarks),
    )


def _camera_of(config: RobotConfig, endpoints: Endpoints) -> PictureSource | None:
    """Return the camera's pictures; None for a robot without one."""
    if config.camera is None or not config.has_camera:
        return None
    # Pillow: at the start, since loading it later would delay a stop.
    from robotctl.app.processes.page_camera import PageCamera  # noqa: PLC0415

    return PageCamera(endpoints.camera_frames, config.camera)


async def _serve(
    page: PageServer,
    server: PageHost,
    listener: socket.socket,
    states: RawSubscriber,
    truths: RawSubscriber | None,
    stopped: StopFlag,
    heartbeat: ProcessHeartbeat,
) -> None:
    """Serve until asked to end."""
    serving = asyncio.create_task(server.serve([listener]))
    deadline_s = time.monotonic()
    while not stopped() and not serving.done():
        page.relay(states.receive(), [] if truths is None else truths.receive())
        heartbeat.beat()
        deadline_s = max(deadline_s + page.period_s, time.monotonic())
        await asyncio.sleep(max(0.0, deadline_s - time.monotonic()))
    server.should_exit = True
    await serving


def run(config: RobotConfig, options: StackOptions) -> None:
    """Serve the page until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    before = read_links(endpoints.web_links)
    listener = listen(config.web, None if before is None else before.port)
    port = listener.getsockname()[1]
    secrets = secrets_of(config.web, Path(options.state or endpoints.web_links.parent))
    access = Access(secrets.tokens, config.web.allowed_hosts, port, is_https=config.web.tls)
    context: zmq.Context[Any] = zmq.Context()
    heard = (*endpoints.published, endpoints.supervisor_notices, endpoints.parameters)
    states = RawSubscriber(context, heard)
    simulated = Path(endpoints.truth.removeprefix("ipc://")).exists()
    truths = RawSubscriber(context, (endpoints.truth,)) if simulated else None
    to_control = RequestSender(context, endpoints.control_requests)
    to_navigation = RequestSender(context, endpoints.navigation_requests)
    to_telemetry = RequestSender(context, endpoints.telemetry_requests)
    writer = ParameterWriter(options)
    to_recorder = RequestSender(context, endpoints.recorder_requests)
    heartbeat = ProcessHeartbeat(os.environ)
    notices = Publisher(context, endpoints.web_notices)
    robot = RobotSide(
        outline_of(config, simulated=simulated, file=writer.writable),
        lambda: Now(time.monotonic_ns(), clock.now_ns()),
        to_control.send,
        to_navigation.send,
        lambda text: notices.send(Notice(clock.now_ns(), Severity.NOTICE, f"web page: {text}")),
        to_telemetry.send,
        to_recorder.send,
        writer.save,
        plan_stores(options.state),
        _camera_of(config, endpoints),
        Computer(Path(options.state or endpoints.web_links.parent)).state,
    )
    desk = Desk(
        has_localiser=config.localisation.method != "none",
        arm_timeout_ns=config.safety.arm_timeout_ms * 1_000_000 + _ARM_NS,
    )
    static = Path(robotctl.__file__).parent / "web" / "static"
    folder = RecordingFolder(Path(options.record)) if options.record else None
    page = PageServer(robot, desk, access, static, RecordingPages(folder, access).routes)
    server = PageHost(page.app, secrets.certificate, secrets.key)
    write_links(endpoints.web_links, links_of(config.web, secrets, port))
    gc.collect()
    gc.freeze()
    try:
        asyncio.run(_serve(page, server, listener, states, truths, stopped, heartbeat))
    finally:
        context.destroy(linger=0)


if __name__ == "__main__":
    sys.exit(enter("web", run))
