"""Whether links that listen could do so now, told before a robot starts."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

from robotctl.messages.mavlink_port import LinkConfig


def refusal(
    family: socket.AddressFamily, kind: socket.SocketKind, address: tuple[Any, ...]
) -> OSError | None:
    """Return why a socket cannot listen at an address; None: it can."""
    with socket.socket(family, kind) as listener:
        if kind is socket.SOCK_STREAM:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(address)
        except OSError as error:
            return error
    return None


def in_use(port: int) -> str:
    """Return what to say of a port that another program has, and how to find that."""
    return f"port {port} is in use by another program, see sudo ss -lnp | grep :{port}"


def busy_links(links: Sequence[LinkConfig]) -> Iterator[str]:
    """Yield a sentence for each link whose port another program has.

    Hosts that are names are left out: to look them up may take long.
    """
    for number, link in enumerate(links):
        kind, host, port = link.address
        if kind not in {"tcpin", "udpin"}:
            continue
        stream = socket.SOCK_STREAM if kind == "tcpin" else socket.SOCK_DGRAM
        with suppress(socket.gaierror):
            (family, *_, address), *_ = socket.getaddrinfo(
                host, port, type=stream, flags=socket.AI_NUMERICHOST
            )
            if refusal(family, stream, address) is not None:
                yield (
                    f"MAVLink {link.url}: {in_use(port)}; the robot is without this link until it "
                    f"is free, --set mavlink.link.{number}.url=URL gives it another port"
                )
