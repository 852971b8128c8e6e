"""The recorder process: whatever waits for the disk, so that nobody else has to."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final, TypeAlias

import zmq

from robotctl.app.config import RobotConfig
from robotctl.app.flight import FlightDumps, RecordCopy
from robotctl.app.log_folder import LogFolder
from robotctl.app.options import StackOptions, options_of_command_line
from robotctl.app.progress import ProgressKeeper, load_progress, progress_file
from robotctl.app.signals import StopFlag
from robotctl.errors import RobotctlError
from robotctl.runtime.clock import RealClock
from robotctl.runtime.flight_ring import RingReader, crashed
from robotctl.runtime.heartbeat import Heartbeat
from robotctl.runtime.messages import ControlState, NavigationState, Notice
from robotctl.runtime.ports import Clock
from robotctl.runtime.topics import (
    Endpoints,
    Publisher,
    Subscriber,
    endpoint_directory,
    ring_path,
)

Message: TypeAlias = ControlState | NavigationState | Notice

PERIOD_NS: Final = 100_000_000
_RETRY_NS: Final = 10_000_000_000
_END_NS: Final = 1_500_000_000
"""The control process, told to end at the same time, has ended by then [ns]."""
_SEVERITY_WARNING: Final = 4


class Recording:
    """All that one robot's recorder does, step by step.

    Parameters
    ----------
    config, options
        Of the robot.
    """

    def __init__(self, config: RobotConfig, options: StackOptions) -> None:
        self._ring = ring = ring_path(options.instance)
        self._keeper: ProgressKeeper | None = None
        self._dumps: FlightDumps | None = None
        self._copy: RecordCopy | None = None
        self._retry_ns = 0
        self._troubled = False
        if options.state:
            saved, _ = load_progress(options)
            self._keeper = ProgressKeeper(progress_file(Path(options.state)), options, saved)
        if options.flights:
            self._dumps = FlightDumps(ring, Path(options.flights))
        if options.record:
            self._copy = RecordCopy(ring, LogFolder(Path(options.record), config.log))

    def step(self, messages: list[Message], now_ns: int) -> tuple[str, ...]:
        """Write what is to be written; return what people should know."""
        notes: tuple[str, ...] = ()
        if self._keeper is not None:
            notes += self._keeper.step(messages, now_ns)
        if self._dumps is not None:
            notes += self._dumps.step(messages, now_ns)
        if self._copy is not None and now_ns >= self._retry_ns:
            notes += self._guarded(self._copy.step, now_ns)
        return notes

    def _guarded(self, write: Callable[[], None], now_ns: int) -> tuple[str, ...]:
        """Log; where the disk refuses, say so once and try again later."""
        try:
            write()
        except OSError as error:
            news = () if self._troubled else (f"logging stopped: {error}",)
            self._troubled = True
            self._retry_ns = now_ns + _RETRY_NS
            self._close_logs()
            return news
        self._troubled = False
        return ()

    def finish(self, receive: Callable[[], list[Message]], clock: Clock) -> None:
        """Take in the end of the control process, which removes its ring; then close everything."""
        deadline_ns = clock.now_ns() + _END_NS
        while self._ring.exists() and clock.now_ns() < deadline_ns:
            clock.sleep_until(clock.now_ns() + PERIOD_NS // 4)
            self.step(receive(), clock.now_ns())
        if self._ring.exists() and not written(self._ring, clock):
            self._ring.replace(crashed(self._ring))
        self.step(receive(), clock.now_ns())
        if self._dumps is None:
            crashed(self._ring).unlink(missing_ok=True)
        if self._keeper is not None:
            self._keeper.close()
        if self._dumps is not None:
            self._dumps.close()
        self._close_logs()

    def _close_logs(self) -> None:
        """Close the logs; on a disk that refuses even that, what it has is what there is."""
        if self._copy is not None:
            try:
                self._copy.close()
            except OSError:
                return


def written(ring: Path, clock: Clock) -> bool:
    """Return whether a process writes the ring; a robot's slowest loop does in 10 ms."""
    reader = RingReader(ring)
    try:
        parts = reader.read()
        clock.sleep_until(clock.now_ns() + PERIOD_NS)
        return bool(parts and reader.read(parts[-1]))
    finally:
        reader.close()


def run(config: RobotConfig, options: StackOptions) -> None:
    """Record until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = RealClock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    with ExitStack() as stack:
        context: zmq.Context[Any] = zmq.Context()
        stack.callback(context.destroy, linger=0)
        messages = Subscriber[Message](context, endpoints.published, Message)
        publisher = Publisher(context, endpoints.recorder_notices)
        recording = Recording(config, options)
        stack.callback(recording.finish, messages.receive, clock)
        heartbeat = Heartbeat(os.environ)
        while not stopped():
            now_ns = clock.now_ns()
            for note in recording.step(messages.receive(), now_ns):
                publisher.send(Notice(now_ns, _SEVERITY_WARNING, note))
            heartbeat.beat()
            clock.sleep_until(now_ns + PERIOD_NS)


def main() -> int:
    """Entry point of the process."""
    options = options_of_command_line(sys.argv)
    try:
        run(options.load(), options)
    except RobotctlError as error:
        print(f"robotctl recorder: {error}", file=sys.stderr)  # noqa: T201
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
