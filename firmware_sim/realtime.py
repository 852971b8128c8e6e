"""Keeps a simulation at the pace of a clock and serves the processes around it.

One thread, absolute deadlines: the loop sleeps until the next event of the bus (frames and the
nodes' timers) or until a client has sent something. A simulator that lags by less than
`LATE_NS` catches up, and its clients see late frames. Beyond that it drops the lost time: the
simulation pauses instead of catching up in a burst, and `late` counts it. `pace.SharedClock` waits
for the simulator, which is then late only if it hangs.
"""

from __future__ import annotations

import contextlib
import gc
import itertools
import os
import select
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from firmware_sim.bus.hub import Hub
from firmware_sim.bus.log import LogWriter
from firmware_sim.bus.serve import Service, sharpen_timers
from firmware_sim.camera.process import CameraProcess
from firmware_sim.pace import MonotonicPace, Pace
from firmware_sim.simulation import Simulation
from firmware_sim.world.publisher import Publisher
from firmware_sim.world.truth import Scan, Truth

LATE_NS = 50_000_000
"""Lag above which lost time is dropped [ns]."""
TRUTH_PERIOD_NS = 20_000_000


class RealTime:
    """The loop of the separate process.

    Parameters
    ----------
    simulation
        The simulation; its time continues from its present value.
    services
        Hubs or bridges.
    pace
        The clock; CLOCK_MONOTONIC by default.

    Attributes
    ----------
    origin_ns
        The clock at time 0 of the simulation [ns]; grows when time is dropped.
    late
        Number of times that time was dropped.
    late_max_ns
        Maximum lateness of the loop, whether it dropped time or not [ns].
    """

    def __init__(
        self, simulation: Simulation, services: Sequence[Service] = (), pace: Pace | None = None
    ) -> None:
        self.simulation = simulation
        self.late = self.late_max_ns = 0
        self.origin_ns = 0
        self._services = services
        self._pace = MonotonicPace() if pace is None else pace
        self._log: LogWriter | None = None
        self._epoch_ns = 0
        self._set_origin(self._pace.now_ns() - simulation.now_ns)

    def run(self, stop: Callable[[], bool], priority: int = 0) -> None:
        """Run until `stop`, called at least every 50 ms, returns true.

        Parameters
        ----------
        stop
            Returns whether to end.
        priority
            Priority of SCHED_FIFO, 1..99, if permitted; 0: none. It is set after the garbage
            collection, whose tens of milliseconds another simulator here must not wait for.
        """
        sharpen_timers()
        gc.collect()
        gc.freeze()
        _raise_priority(priority)
        pace = self._pace
        self._set_origin(pace.now_ns() - self.simulation.now_ns)
        simulation, bus, services = self.simulation, self.simulation.bus, self._services
        while not stop():
            event_ns = simulation.next_event_ns
            latest_ns = bus.now_ns + pace.longest_wait_ns
            due_ns = latest_ns if event_ns is None else min(event_ns, latest_ns)
            select.select(services, (), (), pace.wait_s(due_ns + self.origin_ns))
            now_ns = pace.now_ns()
            self._let_go(now_ns, due_ns)
            simulation.advance(max(now_ns - self.origin_ns, bus.now_ns))
            pace.reached(bus.now_ns + self.origin_ns)
            for service in services:
                service.service(now_ns)

    def write_log(self, log: LogWriter, epoch_ns: int) -> None:
        """Give a log the times of the clock plus an epoch [ns], also when time is dropped."""
        self._log, self._epoch_ns = log, epoch_ns
        self._set_origin(self.origin_ns)

    def publish_truth(self, publisher: Publisher, period_ns: int = TRUTH_PERIOD_NS) -> None:
        """Publish the ground truth every `period_ns` [ns] of the simulation."""
        self._every(period_ns, publisher, self._truth)

    def publish_scans(self, publisher: Publisher) -> None:
        """Publish the lidars' scans at their rates; nothing if there is no lidar."""
        for number, lidar in enumerate(self.simulation.config.simulation.lidars):
            self._every(round(1e9 / lidar.rate_hz), publisher, partial(self._scan, number))

    def take_pictures(self, process: CameraProcess) -> None:
        """Let the camera's process take pictures at its rate; nothing if there is no camera."""
        camera, simulation = self.simulation.config.camera, self.simulation
        if camera is None:
            return
        numbers = itertools.count()

        def expose() -> None:
            stamp_ns = simulation.run_to(simulation.now_ns) + self.origin_ns
            process.expose(next(numbers), stamp_ns, simulation.pose())

        self._repeat(round(1e9 / camera.rate_hz), expose)

    def _every(
        self, period_ns: int, publisher: Publisher, sample: Callable[[], Truth | Scan | None]
    ) -> None:
        def publish() -> None:
            taken = sample()
            if taken is not None:
                publisher.publish(taken)

        self._repeat(period_ns, publish)

    def _repeat(self, period_ns: int, action: Callable[[], None]) -> None:
        bus = self.simulation.bus

        def tick() -> None:
            bus.schedule(bus.now_ns + period_ns, tick)
            action()

        bus.schedule(bus.now_ns + period_ns, tick)

    def _truth(self) -> Truth:
        return self.simulation.truth(
            origin_ns=self.origin_ns, late=self.late, late_max_ns=self.late_max_ns
        )

    def _scan(self, lidar: int) -> Scan | None:
        return self.simulation.scan(lidar, origin_ns=self.origin_ns)

    def _let_go(self, now_ns: int, due_ns: int) -> None:
        """Shift the origin if the loop lags too far behind `due_ns`."""
        lag_ns = now_ns - self.origin_ns - due_ns
        self.late_max_ns = max(self.late_max_ns, lag_ns)
        if lag_ns > LATE_NS:
            self.late += 1
            self._set_origin(self.origin_ns + lag_ns)

    def _set_origin(self, origin_ns: int) -> None:
        self.origin_ns = origin_ns
        for service in self._services:
            if isinstance(service, Hub):
                service.origin_ns = origin_ns
        if self._log is not None:
            self._log.epoch_ns = self._epoch_ns + origin_ns


def _raise_priority(priority: int) -> None:
    """Use SCHED_FIFO for all threads, if permitted, with the loop above the publishers."""
    if priority <= 0:
        return
    below = max(os.sched_get_priority_min(os.SCHED_FIFO), priority - 1)
    with contextlib.suppress(PermissionError):
        for thread in (int(task.name) for task in Path("/proc/self/task").iterdir()):
            taken = priority if thread == threading.get_native_id() else below
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(taken))
