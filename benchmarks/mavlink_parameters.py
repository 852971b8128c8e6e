"""How long it takes to list 500 parameters over TCP, and over a link that loses a fifth."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks import machine
from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.parameters.parameter import Parameter
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.mavlink_port import LinkConfig, Received
from robotctl.workbench.mavlink.companion import COMPONENT, SYSTEM, Companion
from robotctl.workbench.mavlink.parameters import ParameterClient

COUNT = 500
TARGET_S = 2.0
STEP_S = 0.01
LOSS = 0.2


class LossyLinks(MavlinkLinks):
    """Links that lose a fifth of what comes."""

    rng = random.Random(1)

    def poll(self, now_ns: int, timeout_s: float = 0.0) -> list[Received]:
        """Return what is not lost."""
        found = super().poll(now_ns, timeout_s)
        return [each for each in found if self.rng.random() >= LOSS]


@contextmanager
def robot() -> Iterator[int]:
    """Run telemetry at its rate; yield the port of its server."""
    config = load_robot(find_file("diff_drive"))
    table = [Parameter(f"P{n:03}", "limits.v_max_m_s", 0.0, 1.0) for n in range(COUNT)]
    parameters = ParameterSet(Configurations(config, config, contradictions), {}, table)
    over = threading.Event()
    with MavlinkLinks((LinkConfig("tcpin:127.0.0.1:0"),)) as links:
        telemetry = Telemetry(config.mavlink, TelemetryRobot(), links, parameters=parameters)
        telemetry.step(time.monotonic_ns(), [])

        def work() -> None:
            while not over.wait(STEP_S):
                telemetry.step(time.monotonic_ns(), [])

        thread = threading.Thread(target=work)
        thread.start()
        try:
            yield links.status()[0].port
        finally:
            over.set()
            thread.join()


def took_s(kind: type[MavlinkLinks]) -> float:
    """Return how long a list takes [s]."""
    with (
        robot() as port,
        kind((LinkConfig(f"tcpout:127.0.0.1:{port}"),), SYSTEM, COMPONENT) as link,
    ):
        companion = Companion(link, "here")
        companion.find()
        begin_s = time.perf_counter()
        found = ParameterClient(companion).read_all()
        if len(found) != COUNT:
            raise RuntimeError(f"{len(found)} of {COUNT} parameters")
        return time.perf_counter() - begin_s


def run(rounds: int, seconds: float) -> None:
    """List the parameters a few times."""
    clean = [took_s(MavlinkLinks) for _ in range(rounds)]
    lossy = [took_s(LossyLinks) for _ in range(rounds)]
    rows = [("clean", machine.spread(clean, 2)), ("20 % lost", machine.spread(lossy, 2))]
    machine.table(f"Listing {COUNT} parameters", ("link", "s"), rows)
    machine.note(f"clean: {machine.median(clean) / TARGET_S:.2f} of the {TARGET_S:g} s allowed")
