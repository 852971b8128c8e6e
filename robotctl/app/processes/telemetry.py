"""The telemetry process: MAVLink links."""

from __future__ import annotations

import os
import sys
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
        plans=config.lidar is not None or config.localisation.method != "none",
        holonomic=config.drive.holonomic,
    )


def parameters_of(config: RobotConfig, options: StackOptions) -> ParameterSet:
    """Return the parameters of a robot, those included that were set since its start."""
    wanted, _ = kept_values(options)
    return ParameterSet(Configurations(options.load_file(), config, contradictions), wanted)


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


def run(config: RobotConfig, options: StackOptions) -> None:
    """Serve the links until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    context = zmq.Context()
    heard = [endpoints.control_state, endpoints.navigation_state, endpoints.recorder_notices]
    heard.append(endpoints.supervisor_notices)
    heard += [endpoints.lidar] if config.lidar is not None else []
    heard += [endpoints.camera] if config.has_camera else []
    states = Subscriber[State](context, tuple(heard), State)
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
            received = [*states.receive(), *requests.receive()]
            for request in telemetry.step(clock.now_ns(), received):
                if isinstance(request, NavigationRequest):
                    to_navigation.send(request)
                if not isinstance(request, ControlRequest):
                    continue
                if not to_control.send(request) and isinstance(request, EmergencyStop):
                    stop = request
            if stop is not None and to_control.send(stop):
                stop = None
            _publish(telemetry, publisher, parameter_publisher)
            _keep(telemetry, keys, tlog, clock.now_ns())
            heartbeat.beat()
            deadline_ns = max(deadline_ns + 1_000_000_000 // RATE_HZ, clock.now_ns())
            clock.sleep_until(deadline_ns)


if __name__ == "__main__":
    sys.exit(enter("telemetry", run))
