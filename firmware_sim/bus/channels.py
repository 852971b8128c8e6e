"""Path of a simcan channel's socket, and the list of channels.

A channel name `simcan0` means `$XDG_RUNTIME_DIR/robotctl/simcan0.sock`, where that directory
exists, else `/tmp/robotctl-<uid>/simcan0.sock`. A channel with a slash in it is a path itself.
Clients look in both places, so that a hub started by a service and a shell find each other.
"""

from __future__ import annotations

import os
import re
import socket
import stat
from pathlib import Path

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_SUFFIX = ".sock"
_PATH_MAX = 103  # 107 less ".new", which a hub binds first


def directories() -> tuple[Path, ...]:
    """Return the directories in which channels lie, the preferred one first."""
    fallback = Path(f"/tmp/robotctl-{os.getuid()}")  # noqa: S108 - owner and mode are checked
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "robotctl", fallback
    return (fallback,)


def socket_paths(channel: str) -> tuple[Path, ...]:
    """Return the possible socket paths of a channel; a hub uses the first.

    Raises
    ------
    ValueError
        If the channel's name is invalid, or its path is too long for a socket.
    """
    if "/" in channel:
        paths: tuple[Path, ...] = (Path(channel).absolute(),)
    elif _NAME.fullmatch(channel):
        paths = tuple(directory / f"{channel}{_SUFFIX}" for directory in directories())
    else:
        raise ValueError(
            f"channel {channel!r}: allowed are letters, digits, '_', '.' and '-', or a path"
        )
    for path in paths:
        if len(os.fsencode(path)) > _PATH_MAX:
            raise ValueError(f"channel {channel!r}: {path} is longer than {_PATH_MAX} bytes")
    return paths


def running_channels() -> list[str]:
    """Return the names of the channels on which a hub answers, sorted."""
    names = set()
    for directory in directories():
        if directory.is_dir() and os.access(directory, os.R_OK | os.X_OK):
            names |= {
                path.name.removesuffix(_SUFFIX)
                for path in directory.glob(f"*{_SUFFIX}")
                if answers(path)
            }
    return sorted(names)


def answers(path: Path) -> bool:
    """Return whether a process listens on a socket."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        probe.setblocking(False)
        try:
            probe.connect(os.fspath(path))
        except OSError:
            return False
    return True


def private_directory(path: Path) -> None:
    """Make a directory only this user may enter, or check that it is one.

    Raises
    ------
    PermissionError
        If it exists and belongs to another user, or is open to others.
    """
    path.mkdir(mode=0o700, exist_ok=True)
    status = path.lstat()
    mode = stat.S_IMODE(status.st_mode)
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or mode & 0o077:
        raise PermissionError(
            f"{path}: must be a directory of user {os.geteuid()} with mode 700, "
            f"is of user {status.st_uid} with mode {mode:o}"
        )
