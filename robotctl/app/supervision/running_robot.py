"""Robots, real or simulated, that run on this computer, found by their open sockets."""

from __future__ import annotations

import socket
from pathlib import Path

from robotctl.errors import LinkError
from robotctl.runtime.ipc.topics import Endpoints, endpoint_directory, endpoint_path
from robotctl.toml_source import nearest


def running(instance: str) -> Endpoints:
    """Return the sockets of a running robot; without a name, of the only one that runs.

    Raises
    ------
    LinkError
        If there is none, naming those that run; or its folder is open to others.
    """
    names = names_of_running()
    if not instance and len(names) == 1:
        instance = names[0]
    if instance in names:
        return Endpoints(endpoint_directory(instance))
    if not instance:
        found = f"several run: {', '.join(names)}; name one" if names else "none runs"
        raise LinkError(f"no robot: {found}")
    hint = nearest(instance, names) if names else "; none runs"
    raise LinkError(f"{instance}: no robot of that name runs{hint}")


def names_of_running() -> list[str]:
    """Return the names of all robots of this user that run, sorted."""
    folders = endpoint_path("any").parent.glob("*/control.state")
    return sorted(file.parent.name for file in folders if _answers(file))


def _answers(file: Path) -> bool:
    """Return whether a process listens at a socket; a killed robot leaves its file behind."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as end:
        return end.connect_ex(str(file)) == 0
