"""Telemetry on real sockets, and what a ground station hears of it."""

import math
import time

from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.services.registry import SERVICES
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import Ack, Arm, EmergencyStop, Mode, SafetyState, SetMode


class Robot:
    """Telemetry on real links, with two processes that say yes to everything.

    Its clock advances 10 ms a step, faster than time, so that nobody waits for heartbeats.
    """

    def __init__(self, links, states, services=SERVICES, **config):
        self.config = MavlinkConfig(link=links, **config)
        self.links = MavlinkLinks(self.config.link)
        described = TelemetryRobot("tester", "1.2.3")
        self.telemetry = Telemetry(self.config, described, self.links, services)
        self.make_control, self.make_navigation = states
        self.state, self.mode, self.acks = SafetyState.STANDBY, Mode.HOLD, ()
        self.requests = []
        self.now_ns = time.monotonic_ns()

    def step(self):
        self.now_ns += 10_000_000
        now_ns = self.now_ns
        states = [
            self.make_control(now_ns, state=self.state, acks=self.acks, theta_rad=math.pi / 2),
            self.make_navigation(now_ns, mode=self.mode),
        ]
        for request in self.telemetry.step(now_ns, states):
            self.requests.append(request)
            if isinstance(request, Arm):
                self.state = SafetyState.ARMED if request.arm else SafetyState.STANDBY
                self.acks = (Ack(request.request_id, accepted=True),)
            elif isinstance(request, SetMode):
                self.mode = request.mode
            elif isinstance(request, EmergencyStop):
                self.state = SafetyState.EMERGENCY_STOP

    def port(self, link=0):
        return self.links.status()[link].port


def hear(eventually, robot, connection, name, **fields):
    """Return the next message of `name` with these fields."""

    def look():
        while (message := connection.recv_match(type=name, blocking=False)) is not None:
            if all(getattr(message, key) == value for key, value in fields.items()):
                return message
        return None

    return eventually(look, robot.step)
