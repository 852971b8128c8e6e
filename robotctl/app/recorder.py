"""The recorder process: whatever waits for the disk, so that nobody else has to."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import zmq

from robotctl.app.options import StackOptions, options_of_command_line
from robotctl.app.progress import ProgressKeeper, load_progress, progress_file
from robotctl.app.signals import StopFlag
from robotctl.errors import RobotctlError
from robotctl.runtime.clock import RealClock
from robotctl.runtime.heartbeat import Heartbeat
from robotctl.runtime.messages import ControlState, NavigationState, Notice
from robotctl.runtime.topics import Endpoints, Publisher, Subscriber, endpoint_directory

PERIOD_NS: Final = 100_000_000
_SEVERITY_WARNING: Final = 4


def run(options: StackOptions) -> None:
    """Record until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = RealClock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    with ExitStack() as stack:
        context: zmq.Context[Any] = zmq.Context()
        stack.callback(context.destroy, linger=0)
        messages = Subscriber[ControlState | NavigationState | Notice](
            context, endpoints.published, ControlState | NavigationState | Notice
        )
        publisher = Publisher(context, endpoints.recorder_notices)
        keeper = None
        if options.state:
            saved, _ = load_progress(options)
            keeper = ProgressKeeper(progress_file(Path(options.state)), options, saved)
            stack.callback(keeper.close)
        heartbeat = Heartbeat(os.environ)
        while not stopped():
            now_ns = clock.now_ns()
            received = messages.receive()
            notes: tuple[str, ...] = ()
            if keeper is not None:
                notes += keeper.step(received, now_ns)
            for note in notes:
                publisher.send(Notice(now_ns, _SEVERITY_WARNING, note))
            heartbeat.beat()
            clock.sleep_until(now_ns + PERIOD_NS)


def main() -> int:
    """Entry point of the process."""
    options = options_of_command_line(sys.argv)
    try:
        run(options)
    except RobotctlError as error:
        print(f"robotctl recorder: {error}", file=sys.stderr)  # noqa: T201
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
