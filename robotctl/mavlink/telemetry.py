"""Telemetry: the MAVLink microservices put together, one step at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import (
    CanTap,
    Context,
    GroundStation,
    PlanStore,
    Request,
    State,
    TelemetryRobot,
)
from robotctl.mavlink.forwarding import Forwarder
from robotctl.mavlink.ftp.files import Files
from robotctl.mavlink.parameters.parameter_set import NO_PARAMETERS, ParameterSet
from robotctl.mavlink.parameters.store import NoParameterStore, ParameterStore
from robotctl.mavlink.service import Microservice, Router, catalogue_of
from robotctl.mavlink.services.registry import SERVICES
from robotctl.messages.control import Notice, Severity
from robotctl.messages.mavlink_port import MavlinkPort
from robotctl.messages.supervision import SupervisorRequest
from robotctl.messages.tuning import ParameterNews


class Telemetry:
    """The robot as MAVLink sees it: a step depends on its inputs and on messages from the links.

    Parameters
    ----------
    config : MavlinkConfig
        Address, rates and time-outs.
    robot : TelemetryRobot
        Static data about the robot.
    links : MavlinkPort
        Made with the same addresses and links as `config`; the caller closes them.
    services : sequence of Microservice classes
        The services, stepped in this order.
    stores : mapping of PlanStore
        Keep the plans of ground stations, by their kind; others are lost with this process.
    parameters : ParameterSet
        What ground stations may read and set; none, without it.
    parameter_store : ParameterStore
        Keeps them; None: what is set is lost with this process.
    take_key : callable
        Uses and keeps a key for signing with its time stamp; returns why not, empty: it does.
    ask_supervisor : callable
        Hands the supervisor a request; returns whether it is there to take it.
    folders : mapping of Files
        Served as files, by their names in the root, which is "" itself.
    can : CanTap
        The robot's bus, for who asks for its frames; the caller closes it.
    wall_ns : callable
        Returns the time of day [ns since 1970].
    """

    def __init__(
        self,
        config: MavlinkConfig,
        robot: TelemetryRobot,
        links: MavlinkPort,
        services: Sequence[type[Microservice]] = SERVICES,
        *,
        stores: Mapping[str, PlanStore] | None = None,
        parameters: ParameterSet = NO_PARAMETERS,
        parameter_store: ParameterStore | None = None,
        take_key: Callable[[bytes, int], str] | None = None,
        ask_supervisor: Callable[[SupervisorRequest], bool] | None = None,
        folders: Mapping[str, Files] | None = None,
        can: CanTap | None = None,
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        store = parameter_store or NoParameterStore()
        context = Context(config, robot, links, stores or {}, parameters, store)
        context.folders = folders or {}
        context.can = can or context.can
        context.wall_ns = wall_ns
        if take_key is not None:
            context.take_key = take_key
        if ask_supervisor is not None:
            context.ask_supervisor = ask_supervisor
        self._members = tuple(make(context) for make in services)
        self._config = context.config
        context.catalogue = catalogue_of(self._members)
        self._context = context
        self._router = Router(self._members, config)
        self._forwarder = Forwarder(links, config)

    def step(self, now_ns: int, received: Sequence[State]) -> list[Request]:
        """Process received messages, send due ones.

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
        messages = context.links.poll(now_ns)
        context.hear(messages, now_ns)
        self._forwarder.begin()
        for message in messages:
            context.asker = message.peer
            self._forwarder.take(message, now_ns)
            self._router.route(message, now_ns)
        context.asker = None
        self._router.step(now_ns)
        if context.config is not self._config:  # the rates of streams are in it
            self._config = context.config
            context.catalogue = catalogue_of(self._members)
        context.links.flush()
        requests = list(context.requests)
        context.requests.clear()
        return requests

    def say(self, now_ns: int, text: str) -> None:
        """Report something critical."""
        self._context.say(now_ns, text, Severity.CRITICAL)

    def take_notices(self) -> list[Notice]:
        """Return telemetry's own notices since the last call.

        The ground stations have it already: do not hand it to `step` again.
        """
        notices = list(self._context.notices)
        self._context.notices.clear()
        return notices

    def take_news(self) -> list[ParameterNews]:
        """Return what other processes are to know of parameters since the last call."""
        news = list(self._context.news)
        self._context.news.clear()
        return news

    @property
    def ground_stations(self) -> tuple[GroundStation, ...]:
        """The ground stations that are alive."""
        return tuple(self._context.ground_stations.values())
