"""The continuous logs of one robot: its states as MCAP, its bus as candump; files in turn."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from typing import BinaryIO, Final

import can

from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.can.candump import CandumpReader
from robotctl.drivers.can.config import CanConfig
from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.log import (
    LogInUseError,
    McapLog,
    McapLogError,
    is_complete,
    recover,
)
from robotctl.logs.mcap.scene import Scene
from robotctl.messages.ports import Clock
from robotctl.runtime.storage.atomic_file import remove_parts
from robotctl.runtime.storage.log_folder import LogFolder, close_log, is_gone
from robotctl.words import counted

FLUSH_NS: Final = 1_000_000_000
"""Maximum loss when the recorder is killed [ns]."""

_RETRY_NS: Final = 1_000_000_000


class StateLog:
    """Published messages, in `robot-0001.mcap` and so on.

    Parameters
    ----------
    folder
        Where to.
    epoch_ns
        Added to CLOCK_MONOTONIC to get wall time [ns].
    name
        Of the robot.
    scene
        Static data of the robot for viewers; None: nothing.
    """

    def __init__(
        self, folder: LogFolder, epoch_ns: int, name: str, scene: Scene | None = None
    ) -> None:
        self._folder = folder
        self._epoch_ns = epoch_ns
        self._name = name
        self._scene = scene or Scene()
        self._file: BinaryIO | None = None
        self._log: McapLog | None = None
        self._flushed_ns = 0

    def step(self, messages: Sequence[Published], now_ns: int) -> None:
        """Log messages; raises OSError if the disk refuses."""
        if not messages:
            return
        if self._log is None or self._file is None:
            self._file = self._folder.open("robot", "mcap")
            self._log = McapLog(self._file, self._epoch_ns, self._name, self._scene)
        for message in messages:
            self._log.add(message)
        if now_ns - self._flushed_ns >= FLUSH_NS:
            self._flushed_ns = now_ns
            self._log.flush()
            if self._file.tell() > self._folder.file_bytes or is_gone(self._file):
                self.close()

    def close(self) -> None:
        """Complete the file; raises OSError if the disk refuses."""
        log, file = self._log, self._file
        self._log = self._file = None
        if file is None:
            return
        try:
            if log is not None:
                log.close()
        finally:
            close_log(file)


class BusLog:
    """The frames on the host's bus, in `can-0001.log` and so on.

    Parameters
    ----------
    folder
        Where to.
    config
        Which bus.
    epoch_ns
        Added to the clock to get wall time [ns].
    clock
        Of the robot; CLOCK_MONOTONIC by default.
    """

    def __init__(
        self, folder: LogFolder, config: CanConfig, epoch_ns: int, clock: Clock | None = None
    ) -> None:
        self._folder = folder
        self._config = config
        self._epoch_ns = epoch_ns
        self._clock = clock
        self._reader: CandumpReader | None = None
        self._file: BinaryIO | None = None
        self._retry_ns = 0
        self._trouble = ""

    def step(self, now_ns: int) -> tuple[str, ...]:
        """Log received frames; return a message when the bus can no longer be read.

        Raises
        ------
        OSError
            If the disk refuses.
        """
        try:
            if self._reader is None:
                if now_ns < self._retry_ns:
                    return ()
                self._reader = CandumpReader(self._config, self._epoch_ns, self._clock)
                self._trouble = ""
            lines = self._reader.read()
        except (OSError, can.CanError, ValueError) as error:
            self._leave()
            self._retry_ns = now_ns + _RETRY_NS
            news = () if self._trouble else (f"the log cannot read the bus: {error}",)
            self._trouble = str(error)
            return news
        if lines:
            self._write(lines)
        return ()

    def _write(self, lines: str) -> None:
        """Write lines; they reach the kernel at once."""
        if self._file is None:
            self._file = self._folder.open("can", "log")
        self._file.write(os.fsencode(lines))
        self._file.flush()
        if self._file.tell() > self._folder.file_bytes or is_gone(self._file):
            self._file.close()
            self._file = None

    def _leave(self) -> None:
        """Leave the bus."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def close(self) -> None:
        """Leave the bus and close the file; raises OSError if the disk refuses."""
        self._leave()
        file, self._file = self._file, None
        if file is not None:
            close_log(file)


def scene_of(config: RobotConfig) -> Scene:
    """Return the static data of a robot."""
    camera = config.camera
    return Scene(
        config.sonar,
        camera.mount if camera is not None and camera.enabled else None,
        has_localiser=config.localisation.method != "none",
    )


def recover_all(folder: LogFolder) -> tuple[str, ...]:
    """Complete the MCAP logs that a kill or a power cut left open; return a sentence for each.

    Files without a byte, of any log, are removed, and what was left of a completion that was cut
    itself. Files being written are not touched.
    """
    folder.remove_empty()
    remove_parts(folder.directory, "robot-*.mcap")
    notes = []
    for path in sorted(folder.directory.glob("robot-*.mcap")):
        try:
            if not is_complete(path):
                with suppress(LogInUseError):
                    recovered = recover(path)
                    notes.append(
                        f"{path}: was cut, completed with its "
                        f"{counted(recovered.messages, 'message')}{recovered.loss()}"
                    )
        except (OSError, McapLogError) as error:
            notes.append(f"{path}: was cut and cannot be completed: {error}")
    return tuple(notes)
