"""Parameters from a robot's other side, over a clean link and one that loses messages."""

import random
import socket
import time

import pytest

from robotctl.config.robot_file import contradictions, find_file, load_robot
from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.errors import ConfigError, LinkError
from robotctl.mavlink.parameters.parameter_set import Configurations, ParameterSet
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.mavlink_port import LinkConfig, LinkStatus, Peer, Received
from robotctl.workbench.mavlink.companion import COMPONENT, FIND_S, SYSTEM, Companion
from robotctl.workbench.mavlink.parameters import (
    Difference,
    ParameterClient,
    ParameterRefusedError,
    differences,
    matching,
    read,
    save,
)
from tests.mavlink.conftest import Bench

CONFIG = load_robot(find_file("diff_drive"))
PEER = Peer(0, 0)


class LinkToRobot:
    """A link whose other end is telemetry; time passes when it is polled."""

    def __init__(self, loss=0.0, seed=1):
        self.bench, self.loss, self.rng = Bench(), loss, random.Random(seed)
        self.parameters = ParameterSet(Configurations(CONFIG, CONFIG, contradictions), {})
        self.bench.telemetry = Telemetry(
            self.bench.config, self.bench.robot, self.bench.links, parameters=self.parameters
        )
        self.now_s = 0.0
        self.deaf = False

    def arrives(self):
        return self.rng.random() >= self.loss and not self.deaf

    def broadcast(self, message, peers=None):
        self.reply(message, PEER)

    def reply(self, message, peer):
        if self.arrives():
            self.bench.receive(message, SYSTEM, COMPONENT)

    def flush(self):
        pass

    def status(self):
        return (LinkStatus("", True, 0, 0, 0, 0, 0, 0, 0, 1, ""),)

    def poll(self, now_ns, timeout_s=0.0):
        for _ in range(5):
            self.bench.step(self.bench.control(), advance_s=0.01)
        self.now_s += 0.05
        return [Received(message, to) for message, to in self.bench.take() if self.arrives()]


def client_of(link):
    robot = Companion(link, "tcpout:robot:5760", lambda: link.now_s)
    robot.find()
    return ParameterClient(robot)


@pytest.mark.parametrize("kind", ["tcp", "udp"])
def test_a_port_that_nobody_has_is_told_at_once_and_a_silent_one_in_time(kind):
    begin_s = time.monotonic()
    clock_s = lambda: 10.0 * (time.monotonic() - begin_s)  # noqa: E731 - so it takes less
    of_kind = {"tcp": socket.SOCK_STREAM, "udp": socket.SOCK_DGRAM}[kind]
    with socket.socket(type=of_kind) as silent:
        silent.bind(("127.0.0.1", 0))
        url = f"{kind}out:127.0.0.1:{silent.getsockname()[1]}"
        if kind == "tcp":
            silent.listen()
        with (
            MavlinkLinks((LinkConfig(url),), SYSTEM, COMPONENT) as links,
            pytest.raises(LinkError, match="no robot is heard within 10 s"),
        ):
            Companion(links, url, clock_s).find()
    before_s = clock_s()
    with (
        MavlinkLinks((LinkConfig(url),), SYSTEM, COMPONENT) as links,
        pytest.raises(LinkError, match=f"{url}: no robot is there, Connection refused; --link"),
    ):
        Companion(links, url, clock_s).find()
    assert clock_s() - before_s < FIND_S / 2


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_all_parameters_are_read(loss):
    link = LinkToRobot(loss)
    found = client_of(link).read_all()
    assert list(found) == [each.name for each in link.parameters.parameters]
    assert found["CTL_L_KP"].text == "0.65"
    assert found["SAF_ARM_MS"].text == "1000"


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_a_parameter_is_set_and_what_the_robot_says_is_told(loss):
    link = LinkToRobot(loss)
    client = client_of(link)
    reading, said = client.set("SAF_ARM_MS", 1500.0)
    assert reading.text == "1500"
    whole = "SAF_ARM_MS: 1000 -> 1500 after a restart, 1000 until then"
    assert whole.startswith(said)  # parts of a text may be lost
    assert said or loss
    assert client.get("SAF_ARM_MS").value == 1500.0


def test_a_refusal_has_the_robots_reason():
    client = client_of(LinkToRobot())
    with pytest.raises(ParameterRefusedError, match=r"^CTL_L_KP: 101 found, 0 to 100 allowed$"):
        client.set("CTL_L_KP", 101.0)
    with pytest.raises(ParameterRefusedError, match=r"^GRD_DECEL: .* limits.a_max_m_s2 "):
        client.set("GRD_DECEL", 3.0)
    with pytest.raises(ParameterRefusedError, match='did you mean "CTL_L_KP"'):
        client.get("CTL_LL_KP")


def test_silence_ends_with_an_error_that_names_the_link():
    link = LinkToRobot()
    client = client_of(link)
    link.deaf = True
    with pytest.raises(LinkError, match="no answer"):
        client.get("CTL_L_KP")
    with pytest.raises(LinkError, match="tcpout:robot:5760: no robot is heard"):
        client_of(link)


def test_the_program_is_no_ground_station_whose_end_would_stop_the_robot():
    link = LinkToRobot()
    client_of(link).read_all()
    assert link.bench.telemetry.ground_stations == ()


def test_a_saved_file_is_read_again_and_what_differs_is_found(tmp_path):
    link, file = LinkToRobot(), tmp_path / "robot.parm"
    client = client_of(link)
    readings = client.read_all()
    save(file, readings)
    assert differences(readings, read(file)) == []
    client.set("CTL_L_KP", 0.7)
    wanted = read(file) | {"NEW_ONE": 3.0}
    assert differences(client.read_all(), wanted) == [
        Difference("CTL_L_KP", "0.7", "0.65"),
        Difference("NEW_ONE", None, "3"),
    ]


def test_files_of_other_programs_are_read(tmp_path):
    file = tmp_path / "other.params"
    file.write_text(
        "# Vehicle-Id\n1\t1\tCTL_L_KP\t0.7\t9\nCTL_L_KI,4.5\n\nSAF_ARM_MS   1500 # ms\n"
    )
    assert read(file) == {"CTL_L_KP": 0.7, "CTL_L_KI": 4.5, "SAF_ARM_MS": 1500.0}
    file.write_text("CTL_L_KP\nCTL_L_KI four\n")
    with pytest.raises(ConfigError, match=r"other.params:1: .*\n.*other.params:2: "):
        read(file)


def test_patterns_find_names():
    readings = client_of(LinkToRobot()).read_all()
    assert len(matching(readings, "ctl_l_*")) == 8
    assert matching(readings, "") == readings
    with pytest.raises(ParameterRefusedError, match='did you mean "LIM_V_MAX"'):
        matching(readings, "LIM_VMAX")
