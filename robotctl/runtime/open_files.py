"""Limit of the files and sockets that a process may open."""

from __future__ import annotations

import resource
from typing import Final

from robotctl.errors import RobotctlError

NEEDED: Final = 256
"""Limit for each process of a robot: telemetry serves dozens of stations, others open about 50."""


class OpenFilesError(RobotctlError):
    """The limit of open files is too low."""


def need_open_files() -> None:
    """Raise the limit of open files to `NEEDED`, for this process and its children.

    Raises
    ------
    OpenFilesError
        If that is not allowed.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= NEEDED:
        return
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (NEEDED, hard))
    except (ValueError, OSError):
        raise OpenFilesError(
            f"only {hard} files may be open at a time, a robot needs {NEEDED}: raise the limit "
            "with `ulimit -n 1024` in a new shell, or LimitNOFILE= of the service"
        ) from None
