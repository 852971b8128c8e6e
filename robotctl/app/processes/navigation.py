"""The navigation process: the robot's place, mode, mission and behaviours at 20 Hz."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import msgspec
import zmq

from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.app.processes.entry import enter
from robotctl.app.processes.pilot import Pilot
from robotctl.app.processes.progress import StoredProgress, last_pose, load_progress
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.messages.control import (
    ControlState,
    ExternalPose,
    NavigationRequest,
    Notice,
    Severity,
)
from robotctl.messages.estimation import CameraView, LidarScan, LocalisationState
from robotctl.messages.ports import Clock
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestReceiver,
    RequestSender,
    Subscriber,
    endpoint_directory,
)

if TYPE_CHECKING:
    from robotctl.app.localisation.estimators import Estimators


_Heard: TypeAlias = LidarScan | CameraView | Notice


class LocalisationRunner:
    """Lets the estimators work on messages and publishes what they find.

    Parameters
    ----------
    estimators
        Localiser and mapper.
    publisher
        Of the process.
    """

    def __init__(self, estimators: Estimators, publisher: Publisher) -> None:
        self._estimators = estimators
        self._publisher = publisher

    def step(
        self,
        control: ControlState,
        scans: Sequence[LidarScan | CameraView],
        asked: Sequence[NavigationRequest],
        clock: Clock,
    ) -> LocalisationState | None:
        """Take in what was seen since the last step; return where the robot is."""
        begin_ns = clock.now_ns()
        estimators, publisher = self._estimators, self._publisher
        poses = [each for each in asked if isinstance(each, ExternalPose)]
        state = estimators.step(control, scans, poses, begin_ns)
        if state is not None:
            step_us = (clock.now_ns() - begin_ns) / 1000
            publisher.send(msgspec.structs.replace(state, step_us=step_us))
        for picture in (*estimators.pictures(begin_ns), *estimators.given_map(begin_ns)):
            publisher.send(picture)
        for text in estimators.take_notices():
            publisher.send(Notice(begin_ns, Severity.NOTICE, text))
        return state


def resume(pilot: Pilot, options: StackOptions, saved: StoredProgress | None) -> tuple[str, ...]:
    """Let the mission stand where it was before this process started again; return notices."""
    if saved is None or not saved.fits(options):
        return ()
    try:
        pilot.resume(saved.item, saved.item_s_m)
    except ValueError as error:
        return (f"{options.state}: {error}; mode AUTO begins the mission anew",)
    if pilot.mission_completed:
        return ("the mission is completed; mode AUTO repeats it",)
    if not saved.item:
        return ()
    return (f"the mission stands at item {saved.item + 1}; mode AUTO goes on there",)


def run(config: RobotConfig, options: StackOptions) -> None:
    """Navigate until SIGTERM or SIGINT; then the commands expire and the robot comes to rest."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    context = zmq.Context()
    states = Subscriber[ControlState | Notice](
        context, (endpoints.control_state,), ControlState | Notice
    )
    requests = RequestReceiver[NavigationRequest](
        context, endpoints.navigation_requests, NavigationRequest
    )
    publisher = Publisher(context, endpoints.navigation_state)
    to_control = RequestSender(context, endpoints.control_requests)
    heartbeat = ProcessHeartbeat(os.environ)
    pilot = Pilot(config, options)
    saved, notes = load_progress(options)
    if notes := (*notes, *resume(pilot, options, saved)):
        publisher.greet(Notice(clock.now_ns(), Severity.WARNING, "\n".join(notes)))

    def say(text: str) -> None:
        publisher.send(Notice(clock.now_ns(), Severity.NOTICE, text))

    estimators = load_estimators(config, options, last_pose(saved, options), say)
    if estimators is not None and estimators.world_map is not None:
        pilot.learn_map(estimators.world_map)
    place = None if estimators is None else LocalisationRunner(estimators, publisher)
    heard = [endpoints.lidar] if place is not None else []
    heard += [endpoints.camera] if config.camera is not None and config.camera.enabled else []
    sensors = Subscriber[_Heard](context, tuple(heard), _Heard)
    control: ControlState | None = None
    localisation: LocalisationState | None = None
    deadline_ns = clock.now_ns()
    try:
        while not stopped():
            deadline_ns = max(deadline_ns + pilot.period_ns, clock.now_ns())
            clock.sleep_until(deadline_ns)
            begin_ns = clock.now_ns()
            for message in states.receive():
                control = message if isinstance(message, ControlState) else control
            asked = requests.receive()
            scans = [each for each in sensors.receive() if not isinstance(each, Notice)]
            if place is not None and control is not None:
                localisation = place.step(control, scans, asked, clock)
            views = [each for each in scans if isinstance(each, CameraView)]
            command, state = pilot.step(control, localisation, asked, begin_ns, views)
            to_control.send(command)
            for text in pilot.take_notices():
                publisher.send(Notice(begin_ns, Severity.WARNING, text))
            step_us = (clock.now_ns() - begin_ns) / 1000
            publisher.send(msgspec.structs.replace(state, step_us=step_us))
            heartbeat.beat()
    finally:
        context.destroy(linger=0)


if __name__ == "__main__":
    sys.exit(enter("navigation", run))
