"""A recording as one MCAP file: several logs of states merged, or a record of the control loop."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from robotctl.logs.formats.robotctl_log import is_mcap
from robotctl.logs.logs import scene_of
from robotctl.logs.mcap.log import McapLog
from robotctl.logs.mcap.merging import merge
from robotctl.runtime.storage.atomic_file import part_file
from robotctl.workbench.logs.messages import recorded_messages
from robotctl.workbench.logs.rows import RecordingError, log_files


def export_mcap(run: Path, target: Path) -> tuple[int, list[str]]:
    """Write a recording as one MCAP file; return its messages, and what could not be read.

    Of a record of the control loop these are the states after each tick, with frames, pose and
    sonars, and the notices.

    Raises
    ------
    RecordingError
        If it is no recording, or empty.
    OSError
        If a file cannot be read or written.
    """
    files, notes = log_files(run), list[str]()
    with part_file(target) as file:
        if all(map(is_mcap, files)):
            count = merge(files, file, notes)
        else:  # a folder has logs of states only
            count = _write(files[0], file, notes)
        if not count:
            raise RecordingError(f"{run}: nothing is in it")
    return count, notes


def _write(record: Path, target: BinaryIO, notes: list[str]) -> int:
    """Write what a record of the control loop tells; return how many messages of its process."""
    robot = recorded_messages(record, notes)
    scene = scene_of(robot.config)
    log = McapLog(target, robot.header.epoch_ns, robot.config.robot.name, scene)
    count = 0
    for each in robot.messages:
        log.add(each.message)
        count += 1
    log.close()
    return count
