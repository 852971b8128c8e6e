"""The recorder process: all work that waits for the disk."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import zmq

from robotctl.app.processes.entry import enter
from robotctl.app.processes.progress import ProgressKeeper, load_progress, progress_file
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.logs.flight import FlightDumps, RecordCopy
from robotctl.logs.logs import BusLog, StateLog, recover_all, scene_of
from robotctl.logs.mcap.entries import Published
from robotctl.messages.control import Notice, Severity
from robotctl.messages.ports import Clock
from robotctl.messages.recording import RecorderState, SetRecording
from robotctl.runtime.ipc.heartbeat import ProcessHeartbeat
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestReceiver,
    Subscriber,
    endpoint_directory,
    ring_path,
)
from robotctl.runtime.storage.log_folder import LogFolder
from robotctl.runtime.storage.ring_file import crashed, retire

if TYPE_CHECKING:
    from robotctl.logs.pictures import PictureLog
    from robotctl.messages.camera_port import CameraPort

PERIOD_NS: Final = 100_000_000
LISTEN_PERIODS: Final = 20
"""Control periods between reads: the bus brings about eighty frames, a third of a socket's
buffer."""
STATE_NS: Final = 1_000_000_000
"""Period of the recorder's own state [ns]."""
_LOOK_NS: Final = 20_000_000
_RETRY_NS: Final = 10_000_000_000
_END_NS: Final = 1_500_000_000
"""Time by which the control process, asked to end at the same time, has ended [ns]."""


class RobotRecorder:
    """All that one robot's recorder does, step by step.

    Parameters
    ----------
    config, options
        Of the robot.

    Raises
    ------
    LogError, StateError
        If a directory cannot be made.
    """

    def __init__(self, config: RobotConfig, options: StackOptions) -> None:
        self._ring = ring = ring_path(options.instance)
        self._keeper: ProgressKeeper | None = None
        self._dumps: FlightDumps | None = None
        self._logs: Logs | None = None
        self._left: tuple[str, ...] = ()
        self._listen_ns = LISTEN_PERIODS * config.runtime.period_ns
        if options.state:
            saved, _ = load_progress(options)
            self._keeper = ProgressKeeper(
                progress_file(Path(options.state)),
                options,
                saved,
                localised=config.localisation.method != "none",
            )
        if options.flights:
            self._dumps = FlightDumps(ring, Path(options.flights))
        self._folder: LogFolder | None = None
        if options.record:
            self._folder = LogFolder(Path(options.record), config.log)
            self._left = recover_all(self._folder)
            self._logs = Logs(ring, self._folder, config, options)
        self._new_logs = partial(Logs, ring, config=config, options=options)

    @property
    def period_ns(self) -> int:
        """How often `listen` is to be called [ns]."""
        return PERIOD_NS if self._logs is None else self._listen_ns

    def set_recording(self, *, on: bool) -> tuple[str, ...]:
        """Begin the logs of `--record`, or end them; return notices."""
        if self._folder is None or on == (self._logs is not None):
            return ()
        if self._logs is None:
            try:
                self._logs = self._new_logs(folder=self._folder)
            except OSError as error:
                return (f"recording does not begin: {self._folder.directory}: {error.strerror}",)
            return ("recording begins, as a client of the web page asked",)
        notes = self._logs.close()
        self._logs.leave_camera()
        self._logs = None
        return (*notes, "recording ended, as a client of the web page asked")

    def state(self, now_ns: int) -> RecorderState:
        """Return what people should know of it."""
        folder, free = "", None
        if self._folder is not None:
            folder = str(self._folder.directory)
            with suppress(OSError):
                free = shutil.disk_usage(folder).free
        trouble = "" if self._logs is None else self._logs.trouble
        return RecorderState(now_ns, folder, self._logs is not None, trouble, free)

    def look_back(self, now_ns: int) -> tuple[str, ...]:
        """Dump a crash of the previous run; return notices on the data that it left."""
        return self._left + (() if self._dumps is None else self._dumps.step([], now_ns))

    def listen(self, now_ns: int) -> tuple[str, ...]:
        """Empty queues that would overflow before the next `step`."""
        return () if self._logs is None else self._logs.listen(now_ns)

    def step(self, messages: list[Published], now_ns: int) -> tuple[str, ...]:
        """Write pending data; return notices."""
        notes: tuple[str, ...] = ()
        if self._keeper is not None:
            notes += self._keeper.step(messages, now_ns)
        if self._dumps is not None:
            notes += self._dumps.step(messages, now_ns)
        if self._logs is not None:
            notes += self._logs.step(messages, now_ns)
        return notes

    def finish(self, receive: Callable[[], list[Published]], clock: Clock) -> tuple[str, ...]:
        """Handle the end of the control process, which removes its ring; then close everything.

        Returns what people should know, as `step`.
        """
        notes: tuple[str, ...] = ()
        deadline_ns = clock.now_ns() + _END_NS
        while self._ring.exists() and clock.now_ns() < deadline_ns:
            clock.sleep_until(clock.now_ns() + _LOOK_NS)
            notes += self.listen(clock.now_ns())
            notes += self.step(receive(), clock.now_ns())
        retire(self._ring)
        notes += self.step(receive(), clock.now_ns())
        if self._dumps is None:
            crashed(self._ring).unlink(missing_ok=True)
        if self._keeper is not None:
            notes += self._keeper.close()
        if self._dumps is not None:
            notes += self._dumps.close()
        if self._logs is not None:
            notes += self._logs.close()
            self._logs.leave_camera()
        return notes


class Logs:
    """The logs of `--record`, on a disk that may refuse.

    Parameters
    ----------
    ring
        The flight ring.
    folder
        Where to.
    config, options
        Of the robot.
    """

    def __init__(
        self, ring: Path, folder: LogFolder, config: RobotConfig, options: StackOptions
    ) -> None:
        self._folder = folder.directory
        self._copy = RecordCopy(ring, folder)
        self._states = StateLog(folder, options.epoch_ns, config.robot.name, scene_of(config))
        self._bus = BusLog(folder, config.buses, options.epoch_ns, options.open_clock())
        self._pictures = _open_pictures(folder, config, options)
        self._retry_ns = 0
        self.trouble = ""
        """Why nothing is written; empty: it is."""

    def listen(self, now_ns: int) -> tuple[str, ...]:
        """Log the bus."""
        if now_ns < self._retry_ns:
            return ()
        try:
            return self._bus.step(now_ns)
        except OSError as error:
            return self._refused(error, now_ns)

    def step(self, messages: list[Published], now_ns: int) -> tuple[str, ...]:
        """Log states, ticks and the newest picture."""
        if now_ns < self._retry_ns:
            return ()
        try:
            self._copy.step()
            self._states.step(messages, now_ns)
            if self._pictures is not None:
                camera, pictures = self._pictures
                pictures.step(camera.read())
        except OSError as error:
            return self._refused(error, now_ns)
        self.trouble = ""
        return ()

    def _refused(self, error: OSError, now_ns: int) -> tuple[str, ...]:
        """Say that the disk refuses, and try again later.

        Repeated for late subscribers, as all are at a start.
        """
        self._retry_ns = now_ns + _RETRY_NS
        self.close()  # that it refuses this too needs no report
        self.trouble = f"logging stopped: {error.filename or self._folder}: {error.strerror}"
        return (self.trouble,)

    def close(self) -> tuple[str, ...]:
        """Close all files; return a sentence for each whose end the disk refuses."""
        notes = []
        for what, log in (("ticks", self._copy), ("states", self._states), ("bus", self._bus)):
            try:
                log.close()
            except OSError as error:
                notes.append(f"the log of the {what} lacks its end: {error}")
        return tuple(notes)

    def leave_camera(self) -> None:
        """Receive no more pictures."""
        if self._pictures is not None:
            self._pictures[0].close()


def _open_pictures(
    folder: LogFolder, config: RobotConfig, options: StackOptions
) -> tuple[CameraPort, PictureLog] | None:
    """Return where pictures come from and go to; None for a robot that keeps none."""
    if not config.log.pictures_every_s:
        return None
    # NumPy and Pillow.
    from robotctl.drivers.camera.simulated_camera import SimulatedCamera  # noqa: PLC0415
    from robotctl.logs.pictures import PictureLog  # noqa: PLC0415

    address = Endpoints(endpoint_directory(options.instance)).camera_frames
    log = PictureLog(folder, config.log.pictures_every_s, options.epoch_ns)
    return SimulatedCamera(address), log


def run(config: RobotConfig, options: StackOptions) -> None:
    """Record until SIGTERM or SIGINT."""
    stopped = StopFlag()
    clock = options.open_clock()
    endpoints = Endpoints(endpoint_directory(options.instance))
    with ExitStack() as stack:
        context: zmq.Context[Any] = zmq.Context()
        stack.callback(context.destroy, linger=0)
        heard = (*endpoints.published, endpoints.supervisor_notices)
        messages = Subscriber[Published](context, heard, Published)
        publisher = Publisher(context, endpoints.recorder_notices)
        requests = RequestReceiver[SetRecording](context, endpoints.recorder_requests, SetRecording)
        recording = RobotRecorder(config, options)
        stack.callback(_finish, recording, messages.receive, clock)
        if left := recording.look_back(clock.now_ns()):
            publisher.greet(Notice(clock.now_ns(), Severity.WARNING, "\n".join(left)))
        heartbeat = ProcessHeartbeat(os.environ)
        due_ns = state_ns = 0
        while not stopped():
            now_ns = clock.now_ns()
            notes = recording.listen(now_ns)
            if now_ns >= due_ns:
                due_ns = now_ns + PERIOD_NS
                for request in requests.receive():
                    for done in recording.set_recording(on=request.on):
                        publisher.send(Notice(now_ns, Severity.NOTICE, done))
                    state_ns = 0
                notes += recording.step(messages.receive(), now_ns)
            if now_ns >= state_ns:
                state_ns = now_ns + STATE_NS
                publisher.send(recording.state(now_ns))
            publisher.attend()
            for note in notes:
                publisher.send(Notice(now_ns, Severity.WARNING, note))
            heartbeat.beat()
            clock.sleep_until(now_ns + recording.period_ns)


def _finish(recording: RobotRecorder, receive: Callable[[], list[Published]], clock: Clock) -> None:
    """End a recording; the subscribers of its notices may have ended, so the last ones go here."""
    for note in recording.finish(receive, clock):
        with suppress(OSError):  # whoever does not read it
            print(f"robotctl recorder: {note}", file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    sys.exit(enter("recorder", run))
