"""A port that another program has is told before a robot starts."""

import socket

import pytest

from robotctl.drivers.mavlink.listening import busy_links
from robotctl.messages.mavlink_port import LinkConfig

KINDS = {"tcpin": socket.SOCK_STREAM, "udpin": socket.SOCK_DGRAM}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("host", "written"), [("127.0.0.1", "127.0.0.1"), ("::1", "[::1]")])
def test_a_busy_port_is_named_with_what_to_do(kind: str, host: str, written: str) -> None:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, KINDS[kind]) as other:
        other.bind((host, 0))
        if kind == "tcpin":
            other.listen()
        port = other.getsockname()[1]
        links = (LinkConfig("udpout:127.0.0.1:14550"), LinkConfig(f"{kind}:{written}:{port}"))
        (said,) = busy_links(links)
    assert said.startswith(f"MAVLink {kind}:{written}:{port}: port {port} is in use by another")
    assert "--set mavlink.link.1.url=URL" in said
    assert list(busy_links(links)) == []


def test_who_sends_or_is_known_by_a_name_is_not_tried() -> None:
    links = ("udpout:127.0.0.1:1", "tcpout:127.0.0.1:1", "tcpin:no.such.host.invalid:5760")
    assert list(busy_links([LinkConfig(each) for each in links])) == []
