"""Hosts by their names."""

import re
import socket

import pytest

from robotctl.drivers.mavlink.lookup import HostLookup
from tests.drivers.mavlink.bench import readable


def test_a_host_that_is_unknown_does_not_hold_up_the_other_links(party, udp, eventually):
    station = udp()
    robot = party(
        "tcpout:no-such-host.invalid:5760", f"udpout:localhost:{station.getsockname()[1]}"
    )
    eventually(lambda: robot.status(1).open and robot.status(0).errors, robot.step)
    robot.send()
    eventually(lambda: readable(station), robot.step)
    assert not robot.status(0).open


@pytest.mark.parametrize("host", ["192.168.1..20", ".local", "a" * 64])
@pytest.mark.parametrize("kind", ["udpout", "tcpout", "udpin", "tcpin"])
def test_a_host_that_is_no_name_is_refused_before_there_are_links(party, kind, host):
    with pytest.raises(ValueError, match="is no host; allowed: ") as refused:
        party(f"{kind}:{host}:14550")
    assert f'"{host}"' in str(refused.value)


@pytest.mark.parametrize("host", ["192.168.1..20", ".local", "a" * 64])
@pytest.mark.parametrize("kind", [socket.SOCK_DGRAM, socket.SOCK_STREAM])
def test_looking_up_a_host_that_is_no_name_is_an_error_of_the_network(kind, host):
    with pytest.raises(OSError, match=re.escape(host)):
        HostLookup(host, 14550, kind).result()
