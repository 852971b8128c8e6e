"""How a process of the robot begins, and with which status it ends."""

from __future__ import annotations

import sys
from collections.abc import Callable

from robotctl.app.supervision.signals import name_process
from robotctl.config.options import StackOptions, options_of_command_line
from robotctl.config.robot_file import RobotConfig
from robotctl.errors import ConfigError, RobotctlError
from robotctl.runtime.ipc.run_folder import hold_folder

_AGAIN = 1
_BAD_INPUT = 2
"""Exit statuses: the first is tried again, the second is not at the process's first start."""


def enter(
    name: str, run: Callable[[RobotConfig, StackOptions], None], *, device_may_come: bool = False
) -> int:
    """Run a process with the options of its command line; return its exit status.

    Parameters
    ----------
    name
        Of the process, for messages.
    run
        Its work until it is asked to end.
    device_may_come
        Whether an error that is none of the configuration passes when a device is plugged in.
    """
    name_process(name)
    options = options_of_command_line(sys.argv)
    try:
        hold_folder(options.instance)
        run(options.load(), options)
    except RobotctlError as error:
        print(f"robotctl {name}: {error}", file=sys.stderr)  # noqa: T201
        return _AGAIN if device_may_come and not isinstance(error, ConfigError) else _BAD_INPUT
    return 0
