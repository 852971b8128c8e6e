"""Links, and plain sockets at the other end, closed after each test."""

import contextlib
import socket

import pytest

from tests.drivers.mavlink.bench import Party


@pytest.fixture
def party(link_config):
    """Return a function that opens links, closed after the test."""
    with contextlib.ExitStack() as stack:

        def start(*urls, signing=None):
            started = Party(*link_config(*urls), signing=signing)
            stack.enter_context(started.links)
            return started

        yield start


@pytest.fixture
def udp():
    """Return a function that makes UDP sockets, closed after the test."""
    with contextlib.ExitStack() as stack:

        def make():
            made = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            made.bind(("127.0.0.1", 0))
            made.setblocking(False)
            return made

        yield make


@pytest.fixture
def tcp():
    """Return a function that connects to a port, closed after the test."""
    with contextlib.ExitStack() as stack:

        def connect(port):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", port), 5.0))
            connection.setblocking(False)
            return connection

        yield connect
