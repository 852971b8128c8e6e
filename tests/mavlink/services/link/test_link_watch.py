"""A link that does not open is told, once, with what to do; the others work on."""

import contextlib
import errno
import socket

import pytest

from robotctl.drivers.mavlink.link import MavlinkLinks
from robotctl.mavlink.config import MavlinkConfig
from robotctl.mavlink.context import TelemetryRobot
from robotctl.mavlink.telemetry import Telemetry
from robotctl.messages.mavlink_port import LinkStatus

URL = "tcpin:127.0.0.1:5760"


def status(*, is_open, opened=0, errors=0, url=URL, last_error=""):
    return LinkStatus(url, is_open, 0, 0, 0, 0, 0, 0, errors, opened, last_error)


class Told:
    """A bench whose links have the counters that a test sets."""

    def __init__(self, bench):
        self._bench = bench
        bench.links.status = lambda: self.statuses
        self.statuses = (status(is_open=True, opened=1),)

    def after(self, seconds, *statuses):
        """Return what was said within so many seconds of this state."""
        self.statuses = statuses
        self._bench.take()
        self._bench.run(seconds)
        return [notice.text for notice in self._bench.telemetry.take_notices()]


@pytest.fixture
def told(bench):
    return Told(bench)


def test_a_link_that_does_not_open_is_told_once_with_its_url_and_the_reason(told):
    failing = status(is_open=False, errors=1, last_error="port 5760 is in use")
    (line,) = told.after(30.0, failing)
    assert URL in line
    assert "port 5760 is in use" in line


def test_a_link_that_opens_after_all_is_told_and_may_fail_anew(told):
    assert told.after(2.0, status(is_open=False, errors=3, last_error="refused"))
    assert told.after(2.0, status(is_open=True, opened=1, errors=3)) == [f"MAVLink {URL} is open"]
    (line,) = told.after(2.0, status(is_open=False, opened=1, errors=4, last_error="unplugged"))
    assert "unplugged" in line


def test_short_interruptions_and_attempts_that_last_are_told_neither_twice_nor_at_all(told):
    for errors in range(1, 6):
        assert told.after(0.5, status(is_open=False, opened=errors, errors=errors)) == []
        assert told.after(0.5, status(is_open=True, opened=errors + 1, errors=errors)) == []
    lines = []
    for errors in range(10, 15):  # a connection that nobody answers counts as open meanwhile
        lines += told.after(0.3, status(is_open=False, opened=6, errors=errors, last_error="x"))
        lines += told.after(5.0, status(is_open=True, opened=6, errors=errors, last_error="x"))
    assert len(lines) == 1


def test_links_that_work_say_nothing(told):
    waiting = status(is_open=False, errors=0)
    assert told.after(5.0, waiting) == []
    assert told.after(5.0, status(is_open=True, opened=1, errors=7)) == []


def test_a_port_that_another_program_has_is_named_and_taken_over_when_it_is_free(link_config):
    now_ns = 1_000_000_000_000
    with contextlib.ExitStack() as stack:
        other = stack.enter_context(socket.socket())
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        configs = link_config(f"tcpin:127.0.0.1:{port}", "udpin:127.0.0.1:0")
        links = stack.enter_context(MavlinkLinks(configs))
        telemetry = Telemetry(MavlinkConfig(link=configs), TelemetryRobot(), links)

        def said(seconds):
            nonlocal now_ns
            for _ in range(round(seconds / 0.01)):
                now_ns += 10_000_000
                telemetry.step(now_ns, [])
            return [notice.text for notice in telemetry.take_notices()]

        (line,) = said(20.0)
        assert f"tcpin:127.0.0.1:{port}" in line
        assert f"port {port} is in use by another program" in line
        assert "ss -lnp" in line
        assert f"Errno {errno.EADDRINUSE}" not in line
        assert links.status()[1].open
        other.close()
        assert said(6.0) == [f"MAVLink tcpin:127.0.0.1:{port} is open"]
