"""Hubs for tests: in a private directory, driven by hand under virtual time or by a thread."""

import socket
import struct
import threading
import time

import pytest

from firmware_sim.bus.core import Bus
from firmware_sim.bus.hub import Hub
from firmware_sim.bus.serve import serve


@pytest.fixture(autouse=True)
def runtime_directory(tmp_path, monkeypatch):
    """Channels of the tests are the tests' own."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path


class RawClient:
    """A client of a hub that speaks the documented bytes itself."""

    def __init__(self, hub, name="host", options=0):
        self.hub = hub
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.settimeout(5.0)
        self.socket.connect(str(hub.path))
        self.socket.send(struct.pack("=4sHH32s", b"SCH1", options, 0, name.encode()))
        hub.service(0)
        hub.service(0)
        welcome = self.socket.recv(100)
        assert len(welcome) == 32
        assert welcome[:6] == b"SCW2\0\0"
        self.bitrate, self.data_bitrate = struct.unpack_from("=II", welcome, 8)
        self.socket.setblocking(False)

    def send(self, can_id, data=b""):
        self.socket.send(struct.pack("=IBBBB8s", can_id, len(data), 0, 0, 0, data))

    def raw_messages(self):
        """All messages received so far."""
        found = []
        while True:
            try:
                message = self.socket.recv(1024)
            except BlockingIOError:
                return found
            if not message:
                return found
            found.append(message)

    def messages(self):
        """All (id, data, own, stamp) received so far, of classic frames."""
        found = []
        for message in self.raw_messages():
            can_id, length, _, own, _, data, stamp = struct.unpack("=IBBBB8sQ", message)
            found.append((can_id, data[:length], own, stamp))
        return found

    def close(self):
        self.socket.close()


@pytest.fixture
def raw_client(request):
    """Connect a RawClient to a hub; closed at the end."""
    clients = []

    def connect(hub, name="host", options=0):
        clients.append(RawClient(hub, name, options))
        return clients[-1]

    yield connect
    for client in clients:
        client.close()


@pytest.fixture
def hub():
    """A hub on a bus under virtual time; the test advances the bus and serves the hub."""
    hub = Hub(Bus(), "test0", origin_ns=1_000)
    yield hub
    hub.close()


class RunningHub:
    """A hub served in real time by a thread."""

    def __init__(self, channel, **options):
        self.origin_ns = time.monotonic_ns()
        self.bus = Bus(**options)
        self.hub = Hub(self.bus, channel, origin_ns=self.origin_ns)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self):
        serve(self.bus, [self.hub], origin_ns=self.origin_ns, stop=self._stopping.is_set)

    def stop(self):
        if not self._stopping.is_set():
            self._stopping.set()
            self._thread.join()
            self.hub.close()


@pytest.fixture
def running_hub():
    """Start hubs by name; stopped at the end."""
    hubs = []

    def start(channel="simcan0", **options):
        hubs.append(RunningHub(channel, **options))
        return hubs[-1]

    yield start
    for entry in hubs:
        entry.stop()
