"""The telemetry process: MAVLink links."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final
from zlib import crc32

import zmq

import robotctl
from robotctl.app.processes.entry import enter
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.mavlink.context import State, TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import (
    ControlRequest,
    EmergencyStop,
)
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestSender,
    Subscriber,
    endpoint_directory,
)
from robotctl.runtime.storage.atomic_file import write_whole

RATE_HZ: Final = 100

FAREWELL_NS: Final = 200_000_000
"""Time it continues when asked to end, for the last notices of processes that also end [ns].
"""


MISSIONS: Final = "mavlink-mission-{:08x}.toml"
"""Files of missions that came over MAVLink, by their CRC-32, in the folder of what survives
restarts: while navigation decides on a new one there are two."""


class MissionFiles:
    """Keeps a mission in a folder; "": nowhere.

    Parameters
    ----------
    directory
        The folder.
    """

    def __init__(self, directory: str) -> None:
        self._folder = Path(directory).resolve() if directory else None

    def _files(self) -> list[Path]:
        """Return all there are, the oldest first."""
        found = [] if self._folder is None else self._folder.glob("mavlink-mission-*.toml")
        return sorted(found, key=lambda file: file.stat().st_mtime_ns)

    def load(self) -> bytes:
        """Return the last mission that was kept; empty: none was."""
        try:
            files = self._files()
            return files[0].read_bytes() if files else b""
        except OSError:
            return b""

    def save(self, content: bytes) -> str:
        """Save a mission file beside the present one; return its path, empty: it is not kept."""
        if self._folder is None:
            return ""
        file = self._folder / MISSIONS.format(crc32(content))
        try:
            if not file.exists():
                write_whole(file, content)
        except OSError:
            return ""
        return str(file)

    def keep(self, content: bytes) -> None:
        """Remove all that was saved but this."""
        name = MISSIONS.format(crc32(content))
        with suppress(OSError):
            for file in self._files():
                if file.name != name:
                    file.unlink()


def described(config: RobotConfig, options: StackOptions) -> TelemetryRobot:
    """Return telemetry's knowledge of the robot before any message."""
    return TelemetryRobot(
        name=config.robot.name,
        version=robotctl.__version__,
        sonars=config.sonar,
        sonar=config.localisation.sonar,
        has_imu=config.imu.enabled,
        has_localiser=config.localisation.method != "none",
        arm_timeout_s=config.safety.arm_timeout_ms / 1e3,
        home=SE2(options.x_m, options.y_m, options.theta_rad),
        plans=config.lidar is not None or config.localisation.method != "none",
    )


def run(config: RobotConfig, options: StackOptions) -> None:
    """Serve the links until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    context = zmq.Context()
    heard = [endpoints.control_state, endpoints.navigation_state, endpoints.recorder_notices]
    heard.append(endpoints.supervisor_notices)
    heard += [endpoints.camera] if config.camera is not None and config.camera.enabled else []
    states = Subscriber[State](context, tuple(heard), State)
    to_control = RequestSender(context, endpoints.control_requests)
    to_navigation = RequestSender(context, endpoints.navigation_requests)
    publisher = Publisher(context, endpoints.telemetry_notices)
    mavlink = config.mavlink
    with ExitStack() as stack:
        stack.callback(context.destroy, linger=0)
        links = stack.enter_context(
            MavlinkLinks(mavlink.link, mavlink.system_id, mavlink.component_id)
        )
        telemetry = Telemetry(
            mavlink, described(config, options), links, missions=MissionFiles(options.state)
        )
        heartbeat = ProcessHeartbeat(os.environ)
        # The one request that is kept for a control process that is not there yet.
        stop: EmergencyStop | None = None
        deadline_ns = clock.now_ns()
        parent = os.getppid()
        end_ns: int | None = None
        while end_ns is None or clock.now_ns() < end_ns:
            if end_ns is None and stopped():
                end_ns = clock.now_ns() + FAREWELL_NS
            if end_ns is not None and os.getppid() != parent:
                parent = os.getppid()
                telemetry.say(clock.now_ns(), "the supervisor ended: so does robotctl")
            for request in telemetry.step(clock.now_ns(), states.receive()):
                sender = to_control if isinstance(request, ControlRequest) else to_navigation
                if not sender.send(request) and isinstance(request, EmergencyStop):
                    stop = request
            if stop is not None and to_control.send(stop):
                stop = None
            for notice in telemetry.take_notices():
                publisher.send(notice)
            heartbeat.beat()
            deadline_ns = max(deadline_ns + 1_000_000_000 // RATE_HZ, clock.now_ns())
            clock.sleep_until(deadline_ns)


if __name__ == "__main__":
    sys.exit(enter("telemetry", run))
