"""The continuous logs of one robot: states as MCAP, buses as candump, in numbered files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from typing import BinaryIO, Final

import can

from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.can.candump import CandumpReader
from robotctl.drivers.can.config import CanConfig
from robotctl.errors import LinkError
from robotctl.logs.mcap.entries import Published
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.recovery import LogInUseError, McapLogError, is_complete, recover
from robotctl.logs.mcap.scene import Scene
from robotctl.messages.ports import Clock
from robotctl.runtime.storage.atomic_file import remove_parts
from robotctl.runtime.storage.log_folder import LogFolder, close_log, is_gone
from robotctl.words import counted

FLUSH_NS: Final = 1_000_000_000
"""Maximum loss when the recorder is killed [ns]."""

_RETRY_NS: Final = 1_000_000_000
_TIME_WIDTH: Final = len("(1700000000.000000)")


class StateLog:
    """Published messages, in `robot-0001.mcap` and so on.

    Parameters
    ----------
    folder
        Folder of the logs.
    epoch_ns
        Added to CLOCK_MONOTONIC to get wall time [ns].
    name
        Name of the robot.
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
    """Frames on the host's buses, in `can-0001.log` and so on, in the order of their times.

    Parameters
    ----------
    folder
        Folder of the logs.
    buses
        Buses to log.
    epoch_ns
        Added to the clock to get wall time [ns].
    clock
        Clock of the robot; CLOCK_MONOTONIC by default.
    """

    def __init__(
        self,
        folder: LogFolder,
        buses: Sequence[CanConfig],
        epoch_ns: int,
        clock: Clock | None = None,
    ) -> None:
        self._folder = folder
        self._listeners = [_BusListener(bus, epoch_ns, clock) for bus in buses]
        self._file: BinaryIO | None = None

    def step(self, now_ns: int) -> tuple[str, ...]:
        """Log received frames; return a message for each bus that can no longer be read.

        Raises
        ------
        OSError
            If the disk refuses.
        """
        lines: list[str] = []
        notices: list[str] = []
        for listener in self._listeners:
            try:
                lines += listener.read(now_ns)
            except LinkError as error:
                notices.append(str(error))
        if lines:
            self._write(lines if len(self._listeners) == 1 else sorted(lines, key=_time_of))
        return tuple(notices)

    def _write(self, lines: list[str]) -> None:
        """Write lines; they reach the kernel at once."""
        if self._file is None:
            self._file = self._folder.open("can", "log")
        self._file.write(os.fsencode("".join(lines)))
        self._file.flush()
        if self._file.tell() > self._folder.file_bytes or is_gone(self._file):
            self._file.close()
            self._file = None

    def close(self) -> None:
        """Leave the buses and close the file; raises OSError if the disk refuses."""
        for listener in self._listeners:
            listener.close()
        file, self._file = self._file, None
        if file is not None:
            close_log(file)


class _BusListener:
    """Reads one bus, which may appear late and disappear."""

    def __init__(self, bus: CanConfig, epoch_ns: int, clock: Clock | None) -> None:
        self._bus = bus
        self._epoch_ns = epoch_ns
        self._clock = clock
        self._reader: CandumpReader | None = None
        self._retry_ns = 0
        self._trouble = ""

    def read(self, now_ns: int) -> list[str]:
        """Return the lines of the frames since the last call.

        Raises
        ------
        LinkError
            If the bus cannot be read; raised once until it can be read again.
        """
        try:
            if self._reader is None:
                if now_ns < self._retry_ns:
                    return []
                self._reader = CandumpReader(self._bus, self._epoch_ns, self._clock)
                self._trouble = ""
            return self._reader.read()
        except (OSError, can.CanError, ValueError) as error:
            self.close()
            self._retry_ns = now_ns + _RETRY_NS
            is_known, self._trouble = bool(self._trouble), str(error)
            if is_known:
                return []
            raise LinkError(f"the log cannot read bus {self._bus.channel}: {error}") from error

    def close(self) -> None:
        """Leave the bus."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None


def _time_of(line: str) -> str:
    """Return the time of a line of candump, which has a fixed width."""
    return line[:_TIME_WIDTH]


def scene_of(config: RobotConfig) -> Scene:
    """Return the static data of a robot."""
    camera = config.camera
    return Scene(
        config.sonar,
        camera.mount if camera is not None and camera.enabled else None,
        sonar=config.localisation.sonar,
        bodies=config.footprints,
        state=config.body.state or 0,
        has_localiser=config.localisation.method != "none",
    )


def recover_all(folder: LogFolder) -> tuple[str, ...]:
    """Complete the MCAP logs left open by a kill or a power cut; return a sentence for each.

    Empty files of any log are removed, and the rest of an interrupted completion. Files being
    written are not touched.
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
