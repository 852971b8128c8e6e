"""The supervisor of `robotctl run`, on a bench: the same stack, and the same answer to SIGUSR1."""

from __future__ import annotations

import sys
import time

from robotctl.app.supervision.signals import StopFlag, hold_emergency_signal, on_emergency_signal
from robotctl.app.supervision.stack import Stack
from robotctl.app.supervision.supervisor import POLL_S
from robotctl.config.options import options_of_command_line


def main() -> None:
    """Watch the processes until SIGTERM."""
    hold_emergency_signal()
    stopped = StopFlag()
    stack = Stack(options_of_command_line(sys.argv))
    on_emergency_signal(stack.emergency_stop)
    while not stopped():
        stack.watch()
        time.sleep(POLL_S)
    stack.close()


if __name__ == "__main__":
    main()
