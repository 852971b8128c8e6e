"""The navigation process: the robot's place, mode, mission and behaviours at 20 Hz."""

from __future__ import annotations

import gc
import os
import sys
import time
from pathlib import Path
from typing import Final, TypeAlias

import zmq

from robotctl.app.localisation.load_estimators import load_estimators
from robotctl.app.processes.entry import enter
from robotctl.app.processes.navigator import equip, load_mission, make_navigation
from robotctl.app.processes.plan_files import load_bounds
from robotctl.app.processes.progress import StoredProgress, last_pose, load_progress
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.navigation_adapter import NavigationAdapter
from robotctl.core.navigation_tick import NavigationTick
from robotctl.core.operator import Operator
from robotctl.errors import DiskError, RobotctlError
from robotctl.messages.control import ControlState, NavigationRequest, Notice, Severity, StepBudget
from robotctl.messages.estimation import SensorMessage
from robotctl.messages.ports import Clock
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
from robotctl.runtime.simulated_clock import Pacer
from robotctl.runtime.step_timer import StepTimer

_PLAN_S: Final = 0.15
"""Planning in a step; a command lives for 0.2 s [s]."""

_BUDGET_NS: Final = 1_000_000_000
"""Period of the statistics of its steps [ns]."""

_Heard: TypeAlias = SensorMessage | Notice


def resume(
    adapter: NavigationAdapter, options: StackOptions, saved: StoredProgress | None
) -> tuple[str, ...]:
    """Restore mission and progress from before this process restarted; return notices."""
    if saved is None or not saved.fits(options):
        return ()
    navigator = adapter.navigator
    if saved.home is not None:
        navigator.begin_at(SE2(*saved.home))
    try:
        if saved.mission_file:
            mission = load_mission(Path(saved.mission_file))
            content = Path(saved.mission_file).read_bytes()
            adapter.remember(mission, saved.mission_file, content)
        navigator.auto.resume(saved.item, saved.item_s_m, saved.loop_counts)
    except (OSError, ValueError, RobotctlError) as error:
        return (f"{options.state}: {error}; mode AUTO starts the mission over",)
    if navigator.auto.is_completed:
        return ("the mission is completed; mode AUTO repeats it",)
    if not saved.item and not any(saved.loop_counts):
        return ()
    return (f"the mission is at item {saved.item + 1}; mode AUTO resumes there",)


def take_bounds(adapter: NavigationAdapter, options: StackOptions) -> tuple[str, ...]:
    """Keep to the fence from the first step on, and know the rally points; return notices."""
    notices = []
    try:
        adapter.bound_by(load_bounds(options.state, "fence"))
    except DiskError as error:
        adapter.fence.is_damaged = True
        notices.append(f"{error}; until then the robot stands")
    try:
        adapter.bound_by(load_bounds(options.state, "rally points"))
    except DiskError as error:
        notices.append(f"{error}: RTL drives home")
    return tuple(notices)


def run(config: RobotConfig, options: StackOptions) -> None:
    """Navigate until SIGTERM or SIGINT; then the commands expire and the robot comes to rest."""
    stopped = StopFlag()
    clock = options.open_clock(Pacer.NAVIGATION, round(1e9 / config.navigation.rate_hz))
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
    timer = StepTimer(round(1e9 / config.navigation.rate_hz), time.monotonic_ns)
    adapter = make_navigation(config, options, timer)
    saved, notes = load_progress(options)
    if notes := (*notes, *resume(adapter, options, saved), *take_bounds(adapter, options)):
        publisher.greet(Notice(clock.now_ns(), Severity.WARNING, "\n".join(notes)))

    def say(text: str) -> None:
        publisher.send(Notice(clock.now_ns(), Severity.NOTICE, text))

    estimators = load_estimators(config, options, last_pose(saved, options), say)
    scans_count = equip(
        adapter.navigator, config, options, estimators, say, plan_s=_PLAN_S, pace=timer
    )
    try:
        adapter.bound_by(load_bounds(options.state, "zones"))
    except DiskError as error:
        say(str(error))
    tick = NavigationTick(adapter, estimators, Operator(requests.receive, publisher.send))
    heard = [endpoints.lidar] if scans_count else []
    heard += [endpoints.camera] if config.has_camera else []
    sensors = Subscriber[_Heard](context, tuple(heard), _Heard)
    try:
        _navigate(tick, timer, clock, stopped, states, sensors, to_control)
    finally:
        context.destroy(linger=0)
        if estimators is not None:
            estimators.close()


def _navigate(
    tick: NavigationTick,
    timer: StepTimer,
    clock: Clock,
    stopped: StopFlag,
    states: Subscriber[ControlState | Notice],
    sensors: Subscriber[_Heard],
    to_control: RequestSender,
) -> None:
    """Step at the rate of navigation until it is stopped."""
    heartbeat = ProcessHeartbeat(os.environ)
    control: ControlState | None = None
    # A full collection over all compiled code that was loaded takes 0.1 s, two steps.
    gc.collect()
    gc.freeze()
    deadline_ns = clock.now_ns()
    lost_ns = 0
    budget, budget_ns = timer.budget(), deadline_ns
    while not stopped():
        deadline_ns = max(deadline_ns + tick.period_ns, clock.now_ns())
        clock.sleep_until(deadline_ns)
        # Time without the processor: it woke late, or a step took longer than it computed.
        woken_ns, computed_ns = clock.now_ns(), time.process_time_ns()
        late_ns = lost_ns + woken_ns - deadline_ns
        timer.begin()
        for message in states.receive():
            control = message if isinstance(message, ControlState) else control
        seen = [each for each in sensors.receive() if not isinstance(each, Notice)]
        tick.receive(control, seen, late_ns)
        timer.lap("receive")
        begin_ns = clock.now_ns()
        tick.localise(begin_ns)
        localised_ns = clock.now_ns()
        timer.lap("localise")
        command, _ = tick.navigate(begin_ns)
        to_control.send(command)
        done_ns = clock.now_ns()
        timer.lap("decide")
        if done_ns - budget_ns >= _BUDGET_NS:
            before, budget, budget_ns = budget, timer.budget(), done_ns
            if budget.effort != before.effort:
                tick.say(done_ns, _said(budget))
        step_us = (done_ns - begin_ns) / 1000
        tick.publish(begin_ns, (localised_ns - begin_ns) / 1000, step_us, budget)
        timer.lap("publish")
        timer.end()
        heartbeat.beat()
        computed_ns = time.process_time_ns() - computed_ns
        lost_ns = max(0, clock.now_ns() - woken_ns - computed_ns)


def _said(budget: StepBudget) -> str:
    """Return what to tell people of a changed effort."""
    if budget.effort == 1.0:
        return "navigation has time again: it steers by all its samples"
    times = f"{budget.p99_ms:.0f} of {budget.period_ms:.0f} ms"
    return f"navigation's steps take up to {times}: it steers by {budget.effort:.0%} of its samples"


if __name__ == "__main__":
    sys.exit(enter("navigation", run))
