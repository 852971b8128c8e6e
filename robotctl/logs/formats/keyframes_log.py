"""Maps of keyframes stored by SLAM: for continuation, or as logs of their scans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from robotctl.estimation.slam.keyframes.saved_map import HEADING, KeyframeMap, restored
from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import LogFormatError
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.trajectory import Trajectory
from robotctl.runtime.storage.record_log import DamagedLogError, read_records

_PERIOD_NS: Final = 1_000_000_000
"""Interval between two scans of a map [ns], whose own times come from several starts."""


def load_keyframes(path: Path) -> KeyframeMap | None:
    """Return the map in a file; None for an empty or missing file.

    Raises
    ------
    DamagedLogError
        If it is not such a file, or damaged.
    DiskError
        If it cannot be read.
    """
    try:
        return restored(read_records(path, HEADING))
    except ValueError as error:
        raise DamagedLogError(f"{path}: damaged: {error}") from error


def _matches(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(HEADING)) == HEADING


def _read(path: Path, _: ReadOptions) -> Recording:
    """Read a map as a drive from scan to scan, in the order of recording."""
    saved = load_keyframes(path)
    if saved is None:
        raise LogFormatError(f"{path}: no map of keyframes in it")
    poses = [SE2(*row) for row in saved.poses.tolist()]
    stamps_ns = [number * _PERIOD_NS for number in range(len(poses))]
    scans = tuple(
        RecordedScan(replace(each.scan, stamp_ns=stamp_ns), pose)
        for each, stamp_ns, pose in zip(saved.keyframes, stamps_ns, poses, strict=True)
    )
    return Recording(path.name, scans, odometry=Trajectory(np.array(stamps_ns), saved.poses))


KEYFRAMES: Final = LogFormat("a map of keyframes", _matches, _read, has_time_unit=False)
