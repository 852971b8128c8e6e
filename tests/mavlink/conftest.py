"""A robot behind telemetry without sockets, and values for its state.

pymavlink's mavutil plays the ground station elsewhere; it speaks MAVLink 2 only if told so before
it is imported.
"""

import contextlib
import os

os.environ["MAVLINK20"] = "1"

import msgspec
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common

from robotctl.estimation.ranging.sonar_config import SonarModelConfig
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.control import (
    BatteryFeedback,
    BusStatus,
    ControlState,
    LoopStatistics,
    Mode,
    NavigationState,
    Notice,
    SafetyState,
)
from robotctl.messages.mavlink_port import Peer, Received
from robotctl.model.sensors.sonar import SonarMount
from tests.mavlink.real_links import Robot

HEADINGS_DEG = (0, 45, 90, 135, 180, -135, -90, -45)
SONARS = tuple(SonarMount(f"sonar_{h}", 0.1, 0.0, float(h)) for h in HEADINGS_DEG)
SONAR = SonarModelConfig()

CONTROL = ControlState(
    stamp_ns=0,
    state=SafetyState.STANDBY,
    reason="",
    acks=(),
    x_m=1.0,
    y_m=2.0,
    theta_rad=0.0,
    v_m_s=0.0,
    omega_rad_s=0.0,
    v_ref_m_s=0.0,
    omega_ref_rad_s=0.0,
    distance_m=0.0,
    wheel_rad_s=(0.0, 0.0),
    wheel_ref_rad_s=(0.0, 0.0),
    wheel_distance_m=(3.5, 4.5),
    duty=(0.0, 0.0),
    current_a=(0.0, 0.0),
    temperature_c=(20.0, 20.0),
    steering_rad=0.0,
    bus_voltage_v=12.0,
    battery=BatteryFeedback(0, 12.345, 1.5, 0.8, 31.25, low=False, critical=False),
    sonar_m=(1.0, 2.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0),
    sonar_stamp_ns=(0,) * 8,
    nodes=(),
    bus=BusStatus(),
    loop=LoopStatistics(),
)

NAVIGATION = NavigationState(
    stamp_ns=0,
    mode=Mode.HOLD,
    mission="",
    item=0,
    items=0,
    item_name="",
    mission_completed=False,
    mission_failed=False,
    message="",
)

FIRST_PEER = Peer(0, 0)


def control_state(now_ns, **changes):
    """Return a state of the control process stamped `now_ns`."""
    return msgspec.structs.replace(CONTROL, stamp_ns=now_ns, **changes)


def navigation_state(now_ns, **changes):
    """Return a state of the navigation process stamped `now_ns`."""
    return msgspec.structs.replace(NAVIGATION, stamp_ns=now_ns, **changes)


class FakeLinks:
    """Links without sockets. Every message sent is packed and decoded, as the wire would."""

    def __init__(self, count=1):
        self.count = count
        self.clients = tuple(Peer(link, 0) for link in range(count))
        self.incoming = []
        self.sent = []
        self.forwarded = []
        self._codec = common.MAVLink(None, 1, 1)

    def poll(self, now_ns, timeout_s=0.0):
        received, self.incoming = self.incoming, []
        return received

    def peers(self):
        return self.clients

    def broadcast(self, message, peers=None):
        for peer in self.clients if peers is None else peers:
            self.sent.append((self._over_the_wire(message), peer))

    def reply(self, message, peer):
        self.sent.append((self._over_the_wire(message), peer))

    def forward(self, message, peers):
        self.forwarded.append((message, set(peers)))

    def _over_the_wire(self, message):
        return self._codec.decode(bytearray(message.pack(self._codec)))

    def flush(self):
        pass

    def status(self):
        return ()

    def close(self):
        pass


class Bench:
    """Telemetry on fake links under a clock that tests turn."""

    def __init__(self, links=1, sonars=SONARS, sonar=SONAR, holonomic=False, **config):
        self.config = MavlinkConfig(**config)
        self.links = FakeLinks(links)
        self.robot = TelemetryRobot("tester", "1.2.3", sonars, sonar, holonomic=holonomic)
        self.telemetry = Telemetry(self.config, self.robot, self.links)
        self.now_ns = 1_000_000_000_000

    def receive(self, message, system=255, component=190, peer=FIRST_PEER, sequence=0):
        """Let `message` arrive from a ground station, over the wire, by the number of its frame."""
        codec = common.MAVLink(None, system, component)
        codec.seq = sequence
        decoded = codec.decode(bytearray(message.pack(codec)))
        self.links.incoming.append(Received(decoded, peer))

    def command(self, number, *params, confirmation=0, target=(1, 1), **source):
        """Let a COMMAND_LONG arrive."""
        params = (*params, *[0.0] * (7 - len(params)))
        self.receive(
            common.MAVLink_command_long_message(*target, number, confirmation, *params), **source
        )

    def step(self, *states, advance_s=0.02):
        """Advance the clock and step; return the requests. Notices of time 0 are of now."""
        self.now_ns += round(advance_s * 1e9)
        received = [
            msgspec.structs.replace(each, stamp_ns=self.now_ns)
            if isinstance(each, Notice) and not each.stamp_ns
            else each
            for each in states
        ]
        return self.telemetry.step(self.now_ns, received)

    def run(self, seconds, rate_hz=50, **control):
        """Step for a while with a living control process; return the requests."""
        requests = []
        for _ in range(round(seconds * rate_hz)):
            state = control_state(self.now_ns + round(1e9 / rate_hz), **control)
            requests += self.step(state, advance_s=1.0 / rate_hz)
        return requests

    def control(self, **changes):
        """Return a state of the control process of the coming step."""
        return control_state(self.now_ns + 20_000_000, **changes)

    def navigation(self, **changes):
        """Return a state of the navigation process of the coming step."""
        return navigation_state(self.now_ns + 20_000_000, **changes)

    def take(self, name=None):
        """Return the messages sent since the last call (of one name), as (message, target)."""
        sent, self.links.sent = self.links.sent, []
        return [item for item in sent if name is None or item[0].get_type() == name]

    def messages(self, name):
        """Return the messages of `name` sent since the last call."""
        return [message for message, _ in self.take(name)]

    def texts(self):
        """Return the texts said since the last call."""
        return [message.text for message in self.messages("STATUSTEXT")]


@pytest.fixture(scope="session")
def make_bench():
    """Return the class of test benches; a bench keeps nothing between tests."""
    return Bench


@pytest.fixture
def bench():
    """Return a bench with one link."""
    return Bench()


@pytest.fixture(scope="session")
def make_control():
    """Return a function that makes control states."""
    return control_state


@pytest.fixture(scope="session")
def make_navigation():
    """Return a function that makes navigation states."""
    return navigation_state


@pytest.fixture
def start_robot(link_config, make_control, make_navigation):
    """Return a function that starts a robot on some links."""
    with contextlib.ExitStack() as stack:

        def start(*urls, **config):
            robot = Robot(link_config(*urls), (make_control, make_navigation), **config)
            stack.enter_context(robot.links)
            robot.step()
            return robot

        yield start


@pytest.fixture
def station():
    """Return a function that opens a pymavlink connection, closed after the test."""
    with contextlib.ExitStack() as stack:

        def open_station(url):
            connection = mavutil.mavlink_connection(url, source_system=255, dialect="common")
            stack.callback(connection.close)
            return connection

        yield open_station


CONNECTIONS = ["udp client", "udp server", "tcp server"]


@pytest.fixture(params=CONNECTIONS)
def pair(request, start_robot, station, eventually):
    """Return a robot and a ground station that hear each other, over each kind of link."""
    if request.param == "udp client":
        listening = station("udpin:127.0.0.1:0")
        robot = start_robot(f"udpout:127.0.0.1:{listening.port.getsockname()[1]}")
        return robot, listening
    kind = "udpin" if request.param == "udp server" else "tcpin"
    robot = start_robot(f"{kind}:127.0.0.1:0")
    calling = station(f"{'udpout' if kind == 'udpin' else 'tcp'}:127.0.0.1:{robot.port()}")
    calling.mav.heartbeat_send(common.MAV_TYPE_GCS, 8, 0, 0, 4)
    eventually(lambda: robot.links.status()[0].peers, robot.step)
    return robot, calling
