"""The canopen package as master of the simulated nodes, which run in another process."""

from __future__ import annotations

import errno
import itertools
import os
import pty
import select
import signal
import socket
import stat
import subprocess
import sys
import time
import zlib
from contextlib import closing, contextmanager
from pathlib import Path

import can
import canopen
import msgspec
import pytest
import zmq
from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError

from firmware_sim.__main__ import main
from firmware_sim.errors import SimulationError
from firmware_sim.world.publisher import Publisher
from firmware_sim.world.truth import Truth

ROOT = Path(__file__).parents[3]
CONFIGS = ROOT / "configs"
EDS = str(CONFIGS / "motor_controller.eds")
DEADLINE_S = 30.0
HISTORY = (0x1003, True)
"""Objects that are there only after an error."""


def arguments(channel, *options):
    robot, world = CONFIGS / "diff_drive.toml", CONFIGS / "worlds" / "empty_room.toml"
    given = ["--robot", str(robot), "--world", str(world)]
    bus = [] if "--bus" in options else ["--bus", f"simcan:{channel}"]
    return [*given, *bus, *options]


class Firmware:
    """`python -m firmware_sim` as a process, on a channel of its own."""

    def __init__(self, directory, *options):
        self.channel = str(directory / "can.sock")
        self.command = [sys.executable, "-m", "firmware_sim", *arguments(self.channel, *options)]
        self.process = None
        self.start()

    def start(self):
        self.process = subprocess.Popen(
            self.command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
        )
        readable, _, _ = select.select([self.process.stdout], [], [], DEADLINE_S)
        self.ready = self.process.stdout.readline() if readable else ""
        if not self.ready.startswith("ready"):
            self.process.kill()
            raise AssertionError(f"not ready: {self.process.communicate()}")

    def stop(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)
        _, errors = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, errors

    def bus(self):
        return can.Bus(interface="simcan", channel=self.channel)


def wait_for(condition, deadline_s=DEADLINE_S):
    end = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end, "the condition did not come about in time"
        time.sleep(0.01)


@contextmanager
def network_on(firmware):
    network = canopen.Network(firmware.bus())
    network.connect()
    for node_id in (1, 2, 3):
        node = network.add_node(node_id, EDS)
        node.sdo.RESPONSE_TIMEOUT = 5.0
    try:
        yield network
    finally:
        network.disconnect()


def boots_of(network):
    """Return the set of nodes whose boot-up message comes from now on."""
    booted = set()
    for node_id, node in network.items():

        def note(state, node_id=node_id):
            if state == 0:
                booted.add(node_id)

        node.nmt.add_heartbeat_callback(note)
    return booted


@pytest.fixture(scope="module")
def firmware(tmp_path_factory):
    running = Firmware(tmp_path_factory.mktemp("bus"))
    yield running
    assert running.stop() == (0, "")


@pytest.fixture
def network(firmware):
    with network_on(firmware) as network:
        booted = boots_of(network)
        network.nmt.send_command(0x81)
        wait_for(lambda: booted == {1, 2, 3})
        yield network


class TestMaster:
    def test_all_nodes_boot_and_beat_in_their_nmt_state(self, network):
        for state in ("OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"):
            network.nmt.state = state
            for node in network.values():
                wait_for(lambda node=node, state=state: node.nmt.state == state)
            assert [node.nmt.state for node in network.values()] == [state] * 3

    @pytest.mark.parametrize(
        ("node_id", "name", "product"),
        [(1, "robotctl drive", 1), (2, "robotctl sonar ring", 2), (3, "robotctl power", 3)],
    )
    def test_the_nodes_identify_themselves(self, network, node_id, name, product):
        sdo = network[node_id].sdo
        assert sdo["Manufacturer device name"].raw == name
        assert sdo["Identity object"]["Vendor-ID"].raw == 0x526F62
        assert sdo["Identity object"]["Product code"].raw == product
        assert sdo["Identity object"]["Revision number"].raw == 0x10000

    def test_the_drive_knows_the_wire_protocol_and_its_encoders(self, network):
        sdo = network[1].sdo
        assert sdo[0x2001].raw == zlib.crc32((CONFIGS / "robot.dbc").read_bytes())
        assert sdo[0x2002].raw == 2400

    def test_every_readable_object_of_the_eds_is_there_with_its_default(self, network):
        sdo = network[1].sdo
        images = range(0x2110, 0x2114)
        compared = 0
        for index in network[1].object_dictionary:
            entry = network[1].object_dictionary[index]
            variables = [entry] if isinstance(entry, ODVariable) else entry.values()
            for each in variables:
                if each.readable and index not in images and (index, each.subindex != 0) != HISTORY:
                    value = each.decode_raw(sdo.upload(index, each.subindex))
                    assert value == each.default, f"{index:04X}:{each.subindex:02X}"
                    compared += 1
        assert compared > 20

    def test_parameters_are_written_expedited_and_in_segments(self, network):
        sdo = network[1].sdo
        sdo[0x2000].raw = 80
        assert sdo[0x2000].raw == 80
        sdo.download(0x2000, 0, (120).to_bytes(2, "little"), force_segment=True)
        assert sdo[0x2000].raw == 120
        assert len(sdo.upload(0x2111, 0)) == 8

    @pytest.mark.parametrize(
        ("code", "access"),
        [
            (0x06020000, lambda sdo: sdo.upload(0x5000, 0)),
            (0x06090011, lambda sdo: sdo.upload(0x1018, 9)),
            (0x06010002, lambda sdo: sdo.download(0x2001, 0, bytes(4))),
            (0x06010001, lambda sdo: sdo.upload(0x2010, 0)),
            (0x06070010, lambda sdo: sdo.download(0x2000, 0, bytes(4))),
            (0x06090030, lambda sdo: sdo.download(0x2000, 0, bytes(2))),
            (0x08000022, lambda sdo: sdo.download(0x2110, 0, bytes(8))),
            (0x08000024, lambda sdo: sdo.upload(0x1003, 1)),
        ],
    )
    def test_refusals_have_the_codes_of_cia_301(self, network, code, access):
        access_node = network[1].sdo
        if code == 0x08000024:
            access_node.download(0x1003, 0, b"\0")
        with pytest.raises(SdoAbortedError) as refused:
            access(access_node)
        assert refused.value.code == code

    def test_a_block_transfer_is_refused(self, network):
        with pytest.raises(SdoAbortedError) as refused:
            network[1].sdo.open(0x1008, 0, "rb", block_transfer=True)
        assert refused.value.code == 0x05040001

    def test_an_emergency_stop_is_an_emcy_and_clearing_takes_it_back(self, network):
        node = network[1]
        network.send_message(0x001, b"\x05")
        wait_for(lambda: node.emcy.active)
        assert node.emcy.active[0].code == 0xFF01
        assert node.sdo[0x1001].raw == 0x81
        assert node.sdo[0x1003][1].raw == 0x0005FF01
        node.sdo[0x2010].raw = 1
        wait_for(lambda: not node.emcy.active)
        assert node.sdo[0x1001].raw == 0

    def test_the_heartbeat_time_can_be_changed(self, network):
        beats = []
        network[2].nmt.add_heartbeat_callback(beats.append)
        network[2].sdo[0x1017].raw = 10
        wait_for(lambda: len(beats) > 30)
        assert network[2].sdo[0x1017].raw == 10

    def test_sync_brings_wheel_feedback(self, network):
        heard = []
        network.subscribe(0x181, lambda *frame: heard.append(frame))
        network[1].nmt.state = "OPERATIONAL"
        network.sync.transmit()
        wait_for(lambda: heard)
        assert len(heard[0][1]) == 8


class TestProcess:
    def test_sighup_is_a_power_cycle_of_all_nodes(self, firmware, network):
        network[1].sdo[0x2000].raw = 55
        booted = boots_of(network)
        firmware.process.send_signal(signal.SIGHUP)
        wait_for(lambda: booted == {1, 2, 3})
        assert network[1].sdo[0x2000].raw == 100

    def test_restart_is_a_power_cycle_that_keeps_stored_parameters(self, tmp_path):
        firmware = Firmware(tmp_path, "--state", str(tmp_path / "state"))
        with network_on(firmware) as network:
            network[1].sdo[0x2000].raw = 66
            network[1].sdo[0x1010][1].raw = 0x65766173
            network[1].sdo[0x2000].raw = 77
        with firmware.bus() as bus:
            assert firmware.stop() == (0, "")
            with pytest.raises(can.CanOperationError, match="gone"):
                list(bus)
        firmware.start()
        with network_on(firmware) as network:
            assert network[1].sdo[0x2000].raw == 66
        assert firmware.stop(signal.SIGINT) == (0, "")
        assert not Path(firmware.channel).exists()

    def test_a_killed_simulator_starts_again_and_ends_when_told_beforehand(self, tmp_path):
        log = tmp_path / "bus.log"
        firmware = Firmware(tmp_path, "--log", str(log), "--duration", "0.35")
        firmware.stop(signal.SIGKILL)
        firmware.start()
        assert firmware.process.wait(DEADLINE_S) == 0
        firmware.stop()
        ids = [line.split()[2].split("#")[0] for line in log.read_text().splitlines()]
        assert ids[:3] == ["701", "702", "703"]
        assert ids.count("701") == 4


@pytest.fixture(scope="class")
def streaming(tmp_path_factory):
    """A simulator that publishes the truth, and where."""
    directory = tmp_path_factory.mktemp("streaming")
    path = directory / "private" / "truth"
    firmware = Firmware(directory, "--truth", f"ipc://{path}", "--start", "1.5,1.25,90")
    yield firmware, path
    assert firmware.stop() == (0, "")
    assert not path.exists()


@contextmanager
def truth_at(path):
    with zmq.Context() as context, closing(context.socket(zmq.SUB)) as subscriber:
        subscriber.setsockopt(zmq.LINGER, 0)
        subscriber.setsockopt(zmq.RCVTIMEO, round(DEADLINE_S * 1000))
        subscriber.subscribe(b"")
        subscriber.connect(f"ipc://{path}")
        yield lambda: msgspec.msgpack.decode(subscriber.recv(), type=Truth)


class TestTruthStream:
    def test_it_comes_at_its_rate_with_monotonic_stamps(self, streaming):
        firmware, path = streaming
        assert f"truth=ipc://{path}" in firmware.ready
        with truth_at(path) as take:
            samples = [take() for _ in range(20)]
        now_ns = time.monotonic_ns()
        steps = {b.stamp_ns - a.stamp_ns for a, b in itertools.pairwise(samples)}
        assert steps == {20_000_000} or samples[-1].late > samples[0].late
        assert 0 <= now_ns - samples[-1].stamp_ns < 5_000_000_000
        assert (samples[0].x_m, samples[0].y_m) == pytest.approx((1.5, 1.25), abs=0.01)
        assert samples[0].theta_rad == pytest.approx(1.5708, abs=0.01)

    def test_only_the_user_may_listen(self, streaming):
        assert stat.S_IMODE(streaming[1].parent.stat().st_mode) == 0o700

    def test_a_simulator_that_was_held_up_lets_the_lost_time_go(self, streaming):
        firmware, path = streaming
        with truth_at(path) as take:
            before = after = take()
            firmware.process.send_signal(signal.SIGSTOP)
            time.sleep(0.5)
            firmware.process.send_signal(signal.SIGCONT)
            deadline_s = time.monotonic() + DEADLINE_S
            while after.late == before.late:
                assert time.monotonic() < deadline_s, "it does not count the time that it lost"
                after = take()
        assert time.monotonic_ns() - after.stamp_ns < 2_000_000_000
        # What it let go it does not make up for: no burst of heartbeats.
        assert after.bus_frames - before.bus_frames < 30


@pytest.fixture
def signals_kept():
    """Give the test process its signal handlers back."""
    numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--robot", "nowhere.toml"], "nowhere.toml: cannot be read"),
        (["--world", "nowhere.toml"], "nowhere.toml: cannot be read"),
        (["--start", "0,0,0"], "a wall is in the way"),
        (["--start", "100,100,0"], "lies outside"),
        (["--start", "1,2"], "'1,2' is not X,Y,HEADING_DEG"),
        (["--bus", "can77"], "no such CAN interface"),
        (["--bus", "ether:net"], "allowed are simcan:CHANNEL or a CAN interface"),
        (["--bus", "simcan:a b"], "letters, digits"),
        (["--bus", "simcan:a", "--bus", "simcan:b"], "2 given, but"),
        (["--truth", "tcp://*:1"], "allowed is ipc:///ABSOLUTE/PATH"),
        (["--truth", ""], "not an address"),
        (
            ["--truth", "ipc:///tmp/x/y", "--lidar", "ipc:///tmp/x/y"],
            "--lidar: ipc:///tmp/x/y: is that of --truth already",
        ),
        (["--bus", ""], "allowed are simcan:CHANNEL or a CAN interface"),
        (["--log", "/nowhere/x.log"], "No such file or directory"),
        (["--seed", "-1"], "no whole number"),
        (["--priority", "100"], "not in 0..99"),
        (["--duration", "nan"], "no positive number"),
        (["--log-mb", "0"], "no positive number of megabytes"),
        (["--state", __file__], "not a directory"),
        (["--state", f"{__file__}/below"], "not a directory"),
        (["--state", "/proc/nowhere"], "cannot be created"),
        (["--set", "battery.charge=0.5"], 'did you mean "simulation.battery.charge"?'),
        (["--start", "-1,2,0"], "needs `=`, as --start=-1,2,90"),
        (
            ["--robot", str(CONFIGS / "tricycle.toml"), "--lidar", "ipc:///tmp/x/y"],
            "no table [simulation.lidar]",
        ),
        (
            ["--robot", str(CONFIGS / "tricycle.toml"), "--camera", "ipc:///tmp/x/y"],
            "no table [camera]",
        ),
        (
            ["--robot", str(CONFIGS / "diff_drive.toml"), "--camera", "tcp://*:1"],
            "allowed is ipc:///ABSOLUTE/PATH",
        ),
    ],
)
def test_bad_input_is_one_clear_line_and_status_2(tmp_path, capsys, signals_kept, options, text):
    status = 0
    try:
        status = main(arguments(f"{tmp_path}/can.sock", *options))
    except SystemExit as ended:
        status = ended.code
    printed = capsys.readouterr()
    assert (status, printed.out) == (2, "")
    assert text in printed.err
    assert printed.err.count("\n") == 1


LEADER = """
import fcntl, os, subprocess, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
job = subprocess.Popen(sys.argv[1:], process_group=0)
_, status = os.waitpid(job.pid, os.WUNTRACED)
if os.WIFSTOPPED(status):
    job.kill()
print("stopped" if os.WIFSTOPPED(status) else "ended", flush=True)
"""


def test_a_simulator_in_the_background_of_a_terminal_runs_on_while_somebody_types(tmp_path):
    keyboard, terminal = pty.openpty()
    command = [sys.executable, "-m", "firmware_sim", *arguments(f"{tmp_path}/s", "--duration=1")]
    with subprocess.Popen(
        [sys.executable, "-c", LEADER, *command],
        stdin=terminal,
        stdout=subprocess.PIPE,
        start_new_session=True,
        cwd=ROOT,
    ) as leader:
        os.close(terminal)
        assert leader.stdout.readline().startswith(b"ready")
        os.write(keyboard, b"somebody types\n")
        assert leader.stdout.read() == b"ended\n"
    os.close(keyboard)


def test_bad_input_is_the_exit_status_of_the_process(tmp_path):
    command = [sys.executable, "-m", "firmware_sim", *arguments(f"{tmp_path}/s", "--bus", "can77")]
    done = subprocess.run(command, check=False, capture_output=True, timeout=60, cwd=ROOT)
    assert done.returncode == 2


def test_a_truth_directory_open_to_others_is_refused(tmp_path):
    tmp_path.chmod(0o755)
    with pytest.raises(SimulationError, match="0700"):
        Publisher(f"ipc://{tmp_path}/truth")


def test_a_truth_address_that_is_taken_is_refused_and_what_is_there_stays(tmp_path):
    tmp_path.chmod(0o700)
    address = f"ipc://{tmp_path}/truth"
    with Publisher(address):
        with pytest.raises(SimulationError, match="another process publishes there"):
            Publisher(address)
        assert Path(f"{tmp_path}/truth").is_socket()
    Path(f"{tmp_path}/truth").write_text("notes")
    with pytest.raises(SimulationError, match="there is something that is no socket"):
        Publisher(address)
    assert Path(f"{tmp_path}/truth").read_text() == "notes"


def test_the_address_of_a_publisher_that_was_killed_is_free(tmp_path):
    tmp_path.chmod(0o700)
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(f"{tmp_path}/truth")
    with socket.socket(socket.AF_UNIX) as early, socket.socket(socket.AF_UNIX) as late:
        assert early.connect_ex(f"{tmp_path}/truth") == errno.ECONNREFUSED
        with Publisher(f"ipc://{tmp_path}/truth"):
            assert late.connect_ex(f"{tmp_path}/truth") == 0
