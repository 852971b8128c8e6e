"""Robots, real or simulated, that run on this computer: found by the sockets they answer on."""

from __future__ import annotations

import socket
from pathlib import Path

from robotctl.errors import LinkError
from robotctl.runtime.ipc.topics import Endpoints, endpoint_directory, endpoint_path
from robotctl.toml_source import nearest


def running(instance: str) -> Endpoints:
    """Return the sockets of a running robot.

    Raises
    ------
    LinkError
        If there is none, naming those that run; or its folder is open to others.
    """
    folder = endpoint_path(instance)
    found = sorted(file.parent for file in folder.parent.glob("*/control.state") if _answers(file))
    if folder in found:
        return Endpoints(endpoint_directory(instance))
    names = [each.name for each in found]
    hint = nearest(instance, names) if names else "; none runs"
    raise LinkError(f"{instance}: no robot of that name runs{hint}")


def _answers(file: Path) -> bool:
    """Return whether a process listens at a socket; a robot that was killed leaves its own."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as end:
        return end.connect_ex(str(file)) == 0
