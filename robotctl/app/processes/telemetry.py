"""The telemetry process: MAVLink links."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import zmq

import robotctl
from robotctl.app.processes.can_tap import BusTap
from robotctl.app.processes.entry import enter
from robotctl.app.processes.plan_files import plan_stores
from robotctl.app.processes.served_folder import served_folders
from robotctl.app.signing_files import SigningFiles
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.changes import ParameterFile, kept_values
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig, contradictions
from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.drivers.mavlink.signing import MINUTE
from robotctl.drivers.mavlink.tlog import TlogRecorder
from robotctl.mavlink.context import State, TelemetryRobot
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.parameters.published import table_of
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import ControlRequest, EmergencyStop, NavigationRequest
from robotctl.messages.ports import Clock
from robotctl.messages.tuning import ParameterRequest
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestReceiver,
    RequestSender,
    Subscriber,
    endpoint_directory,
)

RATE_HZ: Final = 100

FAREWELL_NS: Final = 200_000_000
"""Time it continues when asked to end, for the last notices of processes that also end [ns].
"""


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
        plans=bool(config.lidars) or config.localisation.method != "none",
        holonomic=config.drive.holonomic,
    )


def parameters_of(config: RobotConfig, options: StackOptions) -> ParameterSet:
    """Return the parameters of a robot, those included that were set since its start."""
    wanted, _ = kept_values(options)
    return ParameterSet(Configurations(options.load_file(), config, contradictions), wanted)


class RobotRequests:
    """Senders of requests; an emergency stop waits for a control process that is not there yet."""

    def __init__(self, to_control: RequestSender, to_navigation: RequestSender) -> None:
        self._to_control = to_control
        self._to_navigation = to_navigation
        self._stop: EmergencyStop | None = None

    def send(self, requests: Iterable[object]) -> None:
        """Send requests to the processes that they are for."""
        for request in requests:
            if isinstance(request, NavigationRequest):
                self._to_navigation.send(request)
            if not isinstance(request, ControlRequest):
                continue
            if not self._to_control.send(request) and isinstance(request, EmergencyStop):
                self._stop = request
        if self._stop is not None and self._to_control.send(self._stop):
            self._stop = None


class Parting:
    """End of the process: after a signal it goes on for `FAREWELL_NS`, to say what has happened."""

    def __init__(self, telemetry: Telemetry, clock: Clock, stopped: StopFlag) -> None:
        self._telemetry = telemetry
        self._clock = clock
        self._stopped = stopped
        self._parent = os.getppid()
        self._end_ns: int | None = None

    def is_over(self) -> bool:
        """Return whether to end now."""
        now_ns = self._clock.now_ns()
        if self._end_ns is None and self._stopped():
            self._end_ns = now_ns + FAREWELL_NS
        if self._end_ns is not None and os.getppid() != self._parent:
            self._parent = os.getppid()
            self._telemetry.say(now_ns, "the supervisor ended: so does robotctl")
        return self._end_ns is not None and now_ns >= self._end_ns


def _keep(telemetry: Telemetry, keys: SigningFiles, tlog: TlogRecorder, now_ns: int) -> None:
    """Keep what outlives this process."""
    keys.save(now_ns)
    tlog.flush(now_ns)
    if trouble := tlog.take_trouble():
        telemetry.say(now_ns, trouble)
    for (system, component, _), ahead in keys.signing.take_ahead().items():
        days = ahead / (1440 * MINUTE)
        telemetry.say(
            now_ns,
            f"Signing: the clock of {system}/{component} is {days:.2f} days ahead of the robot's, "
            "set one of them",
        )


def _publish(telemetry: Telemetry, notices: Publisher, parameters: Publisher) -> None:
    """Tell the other processes what is new."""
    for notice in telemetry.take_notices():
        notices.send(notice)
    for each in telemetry.take_news():
        parameters.send(each)


def _states(
    context: zmq.Context[zmq.Socket[bytes]], endpoints: Endpoints, config: RobotConfig
) -> Subscriber[State]:
    """Return what the other processes publish."""
    heard = [endpoints.control_state, endpoints.navigation_state, endpoints.recorder_notices]
    heard.append(endpoints.supervisor_notices)
    heard += [endpoints.lidar] if config.lidars else []
    heard += [endpoints.camera] if config.has_camera else []
    return Subscriber[State](context, tuple(heard), State)


def run(config: RobotConfig, options: StackOptions) -> None:
    """Serve the links until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    context = zmq.Context()
    states = _states(context, endpoints, config)
    to_control = RequestSender(context, endpoints.control_requests)
    to_navigation = RequestSender(context, endpoints.navigation_requests)
    to_supervisor = RequestSender(context, endpoints.supervisor_requests)
    requests = RequestReceiver[ParameterRequest](
        context, endpoints.telemetry_requests, ParameterRequest
    )
    parameters = parameters_of(config, options)
    store = ParameterFile(options.state)
    store.drop_those_of(options.load_file())
    parameter_publisher = Publisher(context, endpoints.parameters)
    parameter_publisher.greet(table_of(parameters, clock.now_ns()))
    publisher = Publisher(context, endpoints.telemetry_notices)
    mavlink = config.mavlink
    keys = SigningFiles(mavlink, options)
    with ExitStack() as stack:
        stack.callback(context.destroy, linger=0)
        stack.callback(keys.close)
        tlog = TlogRecorder(Path(mavlink.tlog) if mavlink.tlog else None)
        stack.callback(tlog.close)
        links = stack.enter_context(
            MavlinkLinks(mavlink.link, mavlink.system_id, mavlink.component_id, keys.signing, tlog)
        )
        tap = BusTap(config.buses[0])
        stack.callback(tap.close)
        telemetry = Telemetry(
            mavlink,
            described(config, options),
            links,
            stores=plan_stores(options.state),
            parameters=parameters,
            parameter_store=store,
            take_key=keys.take_key,
            ask_supervisor=to_supervisor.send,
            folders=served_folders(options),
            can=tap,
        )
        parting = Parting(telemetry, clock, stopped)
        to_robot = RobotRequests(to_control, to_navigation)
        heartbeat = ProcessHeartbeat(os.environ)
        deadline_ns = clock.now_ns()
        while not parting.is_over():
            received = [*states.receive(), *requests.receive()]
            to_robot.send(telemetry.step(clock.now_ns(), received))
            _publish(telemetry, publisher, parameter_publisher)
            _keep(telemetry, keys, tlog, clock.now_ns())
            heartbeat.beat()
            deadline_ns = max(deadline_ns + 1_000_000_000 // RATE_HZ, clock.now_ns())
            clock.sleep_until(deadline_ns)


if __name__ == "__main__":
    sys.exit(enter("telemetry", run))
