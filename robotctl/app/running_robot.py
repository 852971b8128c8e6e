"""Robots, real or simulated, that run on this computer: found by the sockets they answer on."""

from __future__ import annotations

import socket
from contextlib import suppress
from pathlib import Path

from robotctl.errors import LinkError
from robotctl.runtime.topics import Endpoints, endpoint_directory
from robotctl.toml_source import nearest


def running(instance: str) -> Endpoints:
    """Return the sockets of a running robot.

    Raises
    ------
    LinkError
        If there is none; names those that run.
    """
    folder = endpoint_directory(instance)
    found = sorted(file.parent for file in folder.parent.glob("*/control.state") if _answers(file))
    if folder in found:
        return Endpoints(folder)
    with suppress(OSError):  # it may hold sockets of a robot that has ended
        folder.rmdir()
    names = [each.name for each in found]
    hint = nearest(instance, names) if names else "; none runs"
    raise LinkError(f"{instance}: no robot of that name runs{hint}")


def _answers(file: Path) -> bool:
    """Return whether a process listens at a socket; a robot that was killed leaves its own."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as end:
        return end.connect_ex(str(file)) == 0
