"""Files of `--record` in lockstep: ticks, states and bus, in virtual time from 0 on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from firmware_sim.bus.log import LogWriter
from robotctl.config.robot_file import RobotConfig
from robotctl.core.checkpoint import checkpoint
from robotctl.core.control_core import ControlCore, Inputs, Outputs
from robotctl.logs.logs import StateLog, scene_of
from robotctl.logs.mcap.entries import Published
from robotctl.runtime.flight.recorder import Checkpoint, Recorder, RecordHeader
from robotctl.runtime.storage.log_folder import LogFolder

if TYPE_CHECKING:
    from firmware_sim.bus.core import Bus
    from robotctl.logs.pictures import PictureLog
    from robotctl.messages.camera_port import CameraFrame


class TickLog:
    """Log of every tick, in `control-0001.rec` and so on; each file can be replayed alone.

    Parameters
    ----------
    folder
        Where to.
    header
        Of every file.
    core
        Its state begins every file but the first, which begins with the run.
    """

    def __init__(self, folder: LogFolder, header: RecordHeader, core: ControlCore) -> None:
        self._folder = folder
        self._header = header
        self._core = core
        self._begin = Checkpoint(0)
        self._ticks = 0
        self._file: BinaryIO | None = None
        self._recorder: Recorder | None = None

    def record(self, now_ns: int, inputs: Inputs, outputs: Outputs) -> None:
        """Add the tick that the core has just done; raises OSError if the disk refuses."""
        if self._file is None or self._recorder is None:
            self._file = self._folder.open("control", "rec")
            self._recorder = Recorder(self._file.write, self._header, self._begin)
        self._recorder.record(now_ns, inputs, outputs)
        self._ticks += 1
        if self._file.tell() > self._folder.file_bytes:
            self._begin = Checkpoint(self._ticks, checkpoint(self._core))
            self.close()

    def close(self) -> None:
        """Finish the file; raises OSError if the disk refuses."""
        file, self._file = self._file, None
        if file is not None:
            file.close()


class LockstepLogs:
    """All logs of one run in lockstep. A disk that refuses ends them, not the run.

    Parameters
    ----------
    folder
        Where to.
    buses
        Whose frames are logged, by name; the first as simcan0, others with their name behind that.
    header
        Of the records of ticks.
    core
        Whose ticks are recorded.
    config
        Of the robot.

    Raises
    ------
    OSError
        If the disk refuses already here.

    Attributes
    ----------
    trouble
        Why the logs are not whole; empty if they are.
    """

    def __init__(
        self,
        folder: LogFolder,
        buses: Mapping[str, Bus],
        header: RecordHeader,
        core: ControlCore,
        config: RobotConfig,
    ) -> None:
        self.trouble = ""
        self.directory = folder.directory
        self.run = folder.begin_run()

        def next_file(_path: Path) -> Path:
            return folder.new("can", "log")

        self._ticks = TickLog(folder, header, core)
        self._states = StateLog(folder, 0, config.robot.name, scene_of(config))
        self._pictures: PictureLog | None = None
        if config.log.pictures_every_s:
            # NumPy and Pillow.
            from robotctl.logs.pictures import PictureLog  # noqa: PLC0415

            self._pictures = PictureLog(folder, config.log.pictures_every_s, 0)
        self._files = ExitStack()
        first, *others = buses.items()
        log = LogWriter(
            first[1], folder.new("can", "log"), file_bytes=folder.file_bytes, next_file=next_file
        )
        self._files.enter_context(log)
        for name, bus in others:
            log.add(bus, f"simcan0-{name}")
        self._files.callback(self._ticks.close)
        self._files.callback(self._states.close)

    def tick(self, now_ns: int, inputs: Inputs, outputs: Outputs) -> None:
        """Log a tick."""
        if self.trouble:
            return
        try:
            self._ticks.record(now_ns, inputs, outputs)
        except OSError as error:
            self._give_up(error)

    def states(self, messages: Sequence[Published], now_ns: int) -> None:
        """Log the messages that the processes would publish."""
        if self.trouble:
            return
        try:
            self._states.step(messages, now_ns)
        except OSError as error:
            self._give_up(error)

    def picture(self, frame: CameraFrame | None) -> None:
        """Keep the newest picture if one is due."""
        if self.trouble or self._pictures is None:
            return
        try:
            self._pictures.step(frame)
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Log no more."""
        place = error.filename or self.directory
        self.trouble = f"{place}: logging stopped: {error.strerror}"
        self.close()

    def close(self) -> None:
        """Finish all files."""
        try:
            self._files.close()
        except OSError as error:
            place = error.filename or self.directory
            self.trouble = self.trouble or f"{place}: the logs lack their end: {error.strerror}"

    def __enter__(self) -> LockstepLogs:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
