"""Telemetry: the MAVLink microservices put together, one step at a time."""

from __future__ import annotations

from collections.abc import Sequence

from pymavlink.dialects.v20 import common

from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.guards.stale_link import HeldBack
from robotctl.mavlink.service import (
    Context,
    Microservice,
    Request,
    Router,
    State,
    TelemetryRobot,
)
from robotctl.mavlink.services.arming import Arming
from robotctl.mavlink.services.commands import Commands
from robotctl.mavlink.services.external_pose import ExternalPoses
from robotctl.mavlink.services.ground_stations import GroundStation, GroundStations
from robotctl.mavlink.services.heartbeat import Heartbeat
from robotctl.mavlink.services.link_watch import LinkWatch
from robotctl.mavlink.services.manual_control import ManualControls
from robotctl.mavlink.services.message_requests import MessageRequests
from robotctl.mavlink.services.modes import Modes
from robotctl.mavlink.services.setpoints import Setpoints
from robotctl.mavlink.services.status_text import StatusText
from robotctl.mavlink.services.streams import Streams
from robotctl.mavlink.services.time_sync import TimeSync
from robotctl.messages.control import Notice, Severity
from robotctl.messages.mavlink_port import MavlinkPort


class Telemetry:
    """The robot as MAVLink sees it: a step depends on its inputs and on what the links bring.

    Parameters
    ----------
    config : MavlinkConfig
        Address, rates and time-outs.
    robot : TelemetryRobot
        What it tells about the robot.
    links : MavlinkPort
        Made with the same addresses and links as `config`; the caller closes them.
    """

    def __init__(self, config: MavlinkConfig, robot: TelemetryRobot, links: MavlinkPort) -> None:
        context = Context(config, robot, links)
        streams = Streams(context)
        heartbeat = Heartbeat(context)
        held_back = HeldBack()
        arming = Arming(context, held_back)
        modes = Modes(context, held_back)
        self._ground_stations = GroundStations(context)
        requests = MessageRequests(
            context,
            streams,
            {common.MAVLINK_MSG_ID_HEARTBEAT: lambda now_ns: [heartbeat.message(now_ns)]},
        )
        services: tuple[Microservice, ...] = (
            self._ground_stations,
            held_back,
            Commands(context, (arming, modes, requests)),
            arming,
            modes,
            Setpoints(context),
            ManualControls(context),
            ExternalPoses(context),
            TimeSync(context),
            heartbeat,
            streams,
            LinkWatch(context),
            StatusText(context, self._ground_stations),
        )
        self._context = context
        self._router = Router(services, config)

    def step(self, now_ns: int, received: Sequence[State]) -> list[Request]:
        """Take in what came, send what is due.

        Parameters
        ----------
        now_ns : int
            Monotonic time [ns].
        received : sequence of State
            Messages of the other processes since the last step, oldest first.

        Returns
        -------
        list of ControlRequest and NavigationRequest
            For the other processes, in the order in which they came.
        """
        context = self._context
        context.acks.clear()
        for state in received:
            context.take(state)
        for message in context.links.poll(now_ns):
            self._router.route(message, now_ns)
        self._router.step(now_ns)
        context.links.flush()
        requests = list(context.requests)
        context.requests.clear()
        return requests

    def say(self, now_ns: int, text: str) -> None:
        """Tell people of something critical."""
        self._context.say(now_ns, text, Severity.CRITICAL)

    def take_notices(self) -> list[Notice]:
        """Return what telemetry itself had to say since the last call.

        The ground stations have it already: do not hand it to `step` again.
        """
        notices = list(self._context.notices)
        self._context.notices.clear()
        return notices

    @property
    def ground_stations(self) -> tuple[GroundStation, ...]:
        """The ground stations that are alive."""
        return self._ground_stations.alive
