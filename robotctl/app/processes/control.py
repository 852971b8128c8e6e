"""The control process: one thread, one fixed-rate loop between the CAN bus and the wheels."""

from __future__ import annotations

import functools
import math
import os
import sys
from collections.abc import Sequence

import msgspec
import zmq

from robotctl.app.processes.entry import enter
from robotctl.app.processes.progress import last_pose, load_progress
from robotctl.app.processes.robot import make_core, make_robot, record_header
from robotctl.app.supervision.signals import EmergencySignal, StopFlag
from robotctl.app.supervision.silence import STATE_PERIOD_NS
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.core.checkpoint import checkpoint
from robotctl.core.control_core import ControlCore
from robotctl.core.control_tick import ControlTick
from robotctl.core.operator import Operator
from robotctl.core.warmup import rehearse
from robotctl.errors import LinkError
from robotctl.messages.control import (
    ControlRequest,
    EmergencyStop,
    EmergencyStopSource,
    Notice,
    Severity,
)
from robotctl.messages.faults import Fault, FaultCode
from robotctl.runtime.flight.ring import FlightRing
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.process_lock import claim, claim_bus
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestReceiver,
    endpoint_directory,
    ring_path,
)
from robotctl.runtime.loop import Loop
from robotctl.runtime.realtime import acquire_realtime
from robotctl.runtime.simulated_clock import Pacer


class ControlTicker:
    """A tick among processes: recorded, and its state published at a rate of its own.

    Parameters
    ----------
    tick
        The work of one control period.
    publisher
        To the other processes.
    loop
        The loop that calls, for its statistics.
    ring
        The flight recorder; None if it could not be had.
    heartbeat
        Reports each tick to the supervisor.
    """

    def __init__(
        self,
        tick: ControlTick,
        publisher: Publisher,
        loop: Loop,
        ring: FlightRing | None,
        heartbeat: ProcessHeartbeat,
    ) -> None:
        self.receive = tick.receive
        self.control = tick.control
        self.send = tick.send
        self._tick = tick
        self._publisher = publisher
        self._loop = loop
        self._ring = ring
        self._heartbeat = heartbeat
        self._published_ns = 0

    def publish(self, now_ns: int) -> None:
        """Record each tick; publish notices at once and the state at its own rate."""
        self._heartbeat.beat()
        tick, loop = self._tick, self._loop
        if self._ring is not None:
            self._ring.record(now_ns, tick.inputs, tick.outputs, loop.lag_ns, loop.step_ns)
        tick.publish()
        if now_ns - self._published_ns >= STATE_PERIOD_NS:
            self._published_ns = now_ns
            loop.refresh()
            figures = loop.statistics()
            self._publisher.send(tick.core.snapshot(now_ns, figures, tick.objections))


def continued(options: StackOptions) -> tuple[StackOptions, float, tuple[str, ...]]:
    """Return where this process continues: pose within the same run, odometer [m], notices."""
    saved, notes = load_progress(options)
    if saved is None:
        return options, 0.0, notes
    pose = last_pose(saved, options)
    if pose is None:
        return options, saved.odometer_m, notes
    note = (
        f"the pose is from before the restart: x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, "
        f"{math.degrees(pose.theta_rad):.0f} deg; motion since then is not included"
    )
    options = msgspec.structs.replace(options, x_m=pose.x_m, y_m=pose.y_m, theta_rad=pose.theta_rad)
    return options, saved.odometer_m, (*notes, note)


def open_ring(
    config: RobotConfig, options: StackOptions, core: ControlCore
) -> tuple[FlightRing | None, tuple[str, ...]]:
    """Return the flight recorder; if it is unavailable, None and a notice."""
    try:
        ring = FlightRing(
            ring_path(options.instance),
            record_header(config, options),
            functools.partial(checkpoint, core),
        )
    except LinkError as error:
        return None, (f"no flight recorder: {error}",)
    return ring, ()


def missing_rights(refused: Sequence[str]) -> tuple[Fault, ...]:
    """Return an objection to arming for each real-time right that the machine refused."""
    return tuple(
        Fault(
            FaultCode.RIGHT_MISSING,
            f"real-time right missing: {sentence} (or set runtime.allow_best_effort)",
        )
        for sentence in refused
    )


def run(config: RobotConfig, options: StackOptions) -> None:
    """Run the control loop until SIGTERM or SIGINT; the motors go off first."""
    stopped = StopFlag()
    emergency = EmergencySignal()
    options, odometer_m, notes = continued(options)
    clock = options.open_clock(Pacer.CONTROL)
    folder = endpoint_directory(options.instance)
    claims = [claim_bus(bus.interface, bus.channel) for bus in config.buses]
    claims += [claim(each) for each in sorted({str(folder), options.state} - {""})]
    endpoints = Endpoints(folder)
    context = zmq.Context()
    publisher = Publisher(context, endpoints.control_state)
    requests = RequestReceiver[ControlRequest](context, endpoints.control_requests, ControlRequest)
    robot = make_robot(config, clock)
    rehearse(make_core(config, options), config.runtime.period_ns)
    core = make_core(config, options)
    core.odometer_start_m = odometer_m
    loop = Loop(clock, config.runtime.period_ns)
    heartbeat = ProcessHeartbeat(os.environ)
    ring, ring_notes = open_ring(config, options, core)
    refused = acquire_realtime(config.runtime)
    objections = () if config.runtime.allow_best_effort else missing_rights(refused)

    def ask() -> list[ControlRequest]:
        asked = requests.receive()
        if emergency.take():
            asked.append(EmergencyStop(clock.now_ns(), EmergencyStopSource.OPERATOR))
        return asked

    tick = ControlTick(robot, core, Operator(ask, publisher.send, objections))
    ticker = ControlTicker(tick, publisher, loop, ring, heartbeat)
    if sentences := (*notes, *ring_notes, *refused):
        publisher.greet(Notice(clock.now_ns(), Severity.WARNING, "\n".join(sentences)))
    in_order = False
    try:
        loop.run(ticker, stopped)
        in_order = True
    finally:
        robot.close()
        loop.refresh(whole=True)
        publisher.send(core.snapshot(clock.now_ns(), loop.statistics()))
        if ring is not None and in_order:  # else what led here is wanted
            ring.close()
        publisher.close()
        context.destroy(linger=200)
        for held in claims:
            held.close()


if __name__ == "__main__":
    sys.exit(enter("control", run))
