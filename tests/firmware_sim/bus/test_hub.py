"""The hub: who gets in, what slow, rude and dead clients do, what lies on disk."""

import fcntl
import os
import select
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest

from firmware_sim.bus import channels
from firmware_sim.bus.bits import frame_bits
from firmware_sim.bus.core import Bus
from firmware_sim.bus.errors import BusError, ErrorState
from firmware_sim.bus.faults import Destroy
from firmware_sim.bus.hub import Hub, HubError

MILLISECOND = 1_000_000


def step(hub, duration_ns=MILLISECOND):
    hub.service(0)
    hub.bus.advance(hub.bus.now_ns + duration_ns)
    hub.service(0)


def test_the_socket_is_this_users_alone(hub, runtime_directory):
    assert hub.path == runtime_directory / "robotctl" / "test0.sock"
    assert stat.S_IMODE(hub.path.stat().st_mode) == 0o600
    assert stat.S_IMODE(hub.path.parent.stat().st_mode) == 0o700


def test_without_a_runtime_directory_it_lies_under_tmp(monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    (path,) = channels.socket_paths("simcan0")
    assert str(path) == f"/tmp/robotctl-{os.getuid()}/simcan0.sock"


def test_a_directory_others_may_enter_is_refused(runtime_directory):
    (runtime_directory / "robotctl").mkdir(mode=0o755)
    with pytest.raises(HubError, match="mode 700"):
        Hub(Bus(), "test0")


def test_a_channel_may_be_a_path(tmp_path):
    hub = Hub(Bus(), str(tmp_path / "my.sock"))
    assert (tmp_path / "my.sock").is_socket()
    hub.close()
    assert not (tmp_path / "my.sock").exists()


@pytest.mark.parametrize("channel", ["", "two words", "-x", "a" * 200, "../../x y/" + "z" * 120])
def test_what_is_no_channel_is_refused(channel):
    with pytest.raises(ValueError, match="channel"):
        Hub(Bus(), channel)


def test_a_second_hub_on_a_channel_is_told_of_the_first(hub):
    running = rf"'test0'.*already running.*process {os.getpid()}.*--bus simcan:NAME"
    with pytest.raises(HubError, match=running):
        Hub(Bus(), "test0")


def test_what_a_killed_hub_left_behind_is_no_hindrance(runtime_directory):
    program = textwrap.dedent("""
        import os
        from firmware_sim.bus.core import Bus
        from firmware_sim.bus.hub import Hub
        hub = Hub(Bus(), "test0")
        os.kill(os.getpid(), 9)
    """)
    subprocess.run([sys.executable, "-c", program], check=False, timeout=30)
    assert (runtime_directory / "robotctl" / "test0.sock").is_socket()
    assert "test0" not in channels.running_channels()
    hub = Hub(Bus(), "test0")
    assert "test0" in channels.running_channels()
    hub.close()
    assert "test0" not in channels.running_channels()


def test_a_file_in_the_place_of_the_socket_is_not_overwritten(tmp_path):
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(HubError, match="no socket"):
        Hub(Bus(), str(tmp_path / "notes"))
    assert (tmp_path / "notes").read_text() == "mine"


def test_a_client_is_a_node_under_its_name_and_a_second_one_gets_a_number(hub, raw_client):
    raw_client(hub, "robotctl")
    client = raw_client(hub, "robotctl")
    assert [port.name for port in hub.bus.ports] == ["robotctl", "robotctl#2"]
    assert client.bitrate == 1_000_000


def test_frames_are_stamped_with_the_monotonic_clock(hub, raw_client):
    client = raw_client(hub)
    port = hub.bus.attach("drive", lambda frame: None)
    port.send(0x181)
    hub.bus.advance(MILLISECOND)
    ((_, _, flags, stamp),) = client.messages()
    assert stamp == 1_000 + 1_000 * frame_bits(0x181, b"")
    assert flags == 0


def test_two_clients_hear_each_other_and_own_frames_only_if_wished(hub, raw_client):
    plain, wishing = raw_client(hub, "a"), raw_client(hub, "b", options=1)
    plain.send(0x100)
    wishing.send(0x200)
    step(hub)
    assert [(entry[0], entry[2]) for entry in plain.messages()] == [(0x200, 0)]
    assert [(entry[0], entry[2]) for entry in wishing.messages()] == [(0x100, 0), (0x200, 1)]


def test_filters_are_set_by_the_client(hub, raw_client):
    client = raw_client(hub)
    client.socket.send(b"SCF1" + struct.pack("=4I", 0x181, 0x7FF, 0x700, 0x700))
    hub.service(0)
    port = hub.bus.attach("drive", lambda frame: None)
    for can_id in (0x181, 0x182, 0x701):
        port.send(can_id)
    step(hub)
    assert [entry[0] for entry in client.messages()] == [0x181, 0x701]


def test_rubbish_is_counted_and_harms_nobody(hub, raw_client):
    client = raw_client(hub)
    listener = []
    hub.bus.attach("drive", listener.append)
    for rubbish in (
        b"x",
        bytes(17),
        bytes(500),
        struct.pack("=IBBBB8s", 0x100, 9, 0, 0, 0, b""),
        struct.pack("=IBBBB8s", 0x900, 1, 0, 0, 0, b""),
        struct.pack("=IBBBB8s", 0x20000004, 8, 0, 0, 0, b""),
    ):
        client.socket.send(rubbish)
    client.send(0x100)
    step(hub)
    assert [frame.arbitration_id for frame in listener] == [0x100]
    assert hub.clients[0].malformed == 6


def test_who_says_nothing_is_sent_away(hub):
    silent = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    silent.settimeout(5.0)
    silent.connect(str(hub.path))
    hub.service(0)
    assert len(hub.clients) == 1
    hub.service(3_000 * MILLISECOND)
    assert silent.recv(10) == b""
    assert hub.clients == ()
    silent.close()


def test_another_user_is_refused():
    """Needs root, who alone can become somebody else; reported where it is missing."""
    if os.geteuid() != 0:
        pytest.skip("only root can connect as another user")
    with tempfile.TemporaryDirectory() as directory:
        Path(directory).chmod(0o755)
        hub = Hub(Bus(), f"{directory}/open.sock")
        hub.path.chmod(0o777)  # its own mode would stop him before the check does
        refuse_another_user(hub)
        hub.close()


def refuse_another_user(hub):
    program = textwrap.dedent("""
        import os, socket, sys
        os.setuid(65534)
        client = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        client.settimeout(20)
        client.connect(sys.argv[1])
        print("connected", flush=True)
        try:
            client.send(b"SCH1" + bytes(36))
            print(len(client.recv(100)))
        except (BrokenPipeError, ConnectionResetError):
            print(0)
    """)
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(hub.path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "connected\n"
    hub.service(0)
    assert process.communicate(timeout=30)[0] == "0\n"
    assert hub.clients == ()


def test_a_client_that_goes_leaves_its_last_frames_behind(hub, raw_client):
    listener = []
    hub.bus.attach("drive", listener.append)
    client = raw_client(hub)
    for number in range(90):  # more than the queue takes
        client.send(0x200, bytes([number]))
    client.close()
    for _ in range(20):
        step(hub)
    assert [frame.data[0] for frame in listener] == list(range(90))
    assert [port.name for port in hub.bus.ports] == ["drive"]
    assert hub.clients == ()


def test_a_client_that_goes_with_frames_unread_leaves_its_last_frames_behind_too(hub, raw_client):
    # Linux tells the other side of such a socket an error first (ECONNRESET), then what was sent.
    listener = []
    drive = hub.bus.attach("drive", listener.append)
    client = raw_client(hub)
    drive.send(0x181, b"unread")
    step(hub)
    for number in range(3):
        client.send(0x201, bytes([number]))
    client.close()
    for _ in range(5):
        step(hub)
    assert [frame.data[0] for frame in listener] == [0, 1, 2]
    assert hub.clients == ()


def test_a_client_that_goes_unheard_leaves_no_ghost(hub, raw_client):
    client = raw_client(hub)
    client.send(0x200)
    step(hub)
    client.close()
    step(hub)
    assert hub.bus.ports == ()
    assert hub.bus.next_event_ns is None


def test_a_flooding_client_is_held_back_and_told_by_its_own_socket(hub, raw_client):
    client = raw_client(hub)  # alone: nothing gets out

    def flood():
        for _ in range(5000):
            client.send(0x200)
            hub.service(0)

    with pytest.raises(BlockingIOError):
        flood()
    step(hub)
    hub.service(0)
    assert hub.bus.ports[0].pending == 64
    # While it is held back, its full socket does not keep the owner awake.
    assert select.select([hub], [], [], 0)[0] == []


def test_what_a_bus_off_client_sends_is_dropped(hub, raw_client):
    client = raw_client(hub, options=2)
    listener = []
    hub.bus.attach("drive", listener.append)
    hub.bus.inject(Destroy(error=BusError.BIT_ERROR, count=32))
    client.send(0x200, b"old")
    step(hub, 10 * MILLISECOND)
    assert hub.bus.ports[0].state is ErrorState.BUS_OFF
    client.send(0x200, b"stale")
    step(hub, 200 * MILLISECOND)
    client.send(0x200, b"new")
    step(hub)
    assert [frame.data for frame in listener] == [b"new"]
    assert hub.clients[0].dropped == 1
    classes = [entry[0] & 0x140 for entry in client.messages() if entry[0] & 0x20000000]
    assert classes[-2:] == [0x040, 0x100]  # BUSOFF, RESTARTED


def test_a_slow_client_loses_frames_and_is_told_of_the_overflow(raw_client):
    hub = Hub(Bus(), "test0", backlog=10)
    client = raw_client(hub)
    port = hub.bus.attach("drive", lambda frame: None, queue_limit=10_000)
    for number in range(2000):
        port.send(0x181, number.to_bytes(2, "little"))
    hub.bus.advance(2_000 * MILLISECOND)
    lost = hub.clients[0].lost
    assert lost > 0
    messages = client.messages()
    hub.service(0)
    messages += client.messages()
    hub.service(0)
    messages += client.messages()
    numbers = [int.from_bytes(data, "little") for can_id, data, *_ in messages if can_id == 0x181]
    assert numbers == list(range(2000 - lost))
    assert messages[-1][:2] == (0x20000004, bytes((0, 1, 0, 0, 0, 0, 0, 0)))  # CRTL, RX_OVERFLOW
    port.send(0x182)
    step(hub)
    assert [entry[0] for entry in client.messages()] == [0x182]
    hub.close()


def test_a_dead_client_does_not_disturb_the_others(hub, raw_client):
    dead, alive = raw_client(hub, "dead"), raw_client(hub, "alive")
    port = hub.bus.attach("drive", lambda frame: None)
    dead.close()
    port.send(0x181)
    step(hub)
    assert [entry[0] for entry in alive.messages()] == [0x181]
    assert [port.name for port in hub.bus.ports] == ["alive", "drive"]


def test_closing_the_hub_ends_its_clients_and_frees_channel_and_ports(raw_client):
    bus = Bus()
    hub = Hub(bus, "test0")
    client = raw_client(hub)
    hub.close()
    assert client.socket.recv(10) == b""
    assert list(hub.path.parent.iterdir()) == []
    assert bus.ports == ()
    Hub(bus, "test0").close()


def test_the_lock_is_the_hubs_while_it_lives(hub):
    with Path(f"{hub.path}.lock").open() as lock, pytest.raises(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
