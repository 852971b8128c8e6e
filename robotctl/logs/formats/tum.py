"""Trajectories as TUM files, which `evo` and other tools for trajectories read and write.

One pose a line: `t x y z qx qy qz qw`, time [s], position [m], orientation as a unit quaternion;
lines with # are comments. Our poses are in the plane: z, qx and qy are 0.
Format: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from robotctl.logs.formats.log_format import LogFormat, ReadOptions
from robotctl.logs.formats.log_text import (
    LogFormatError,
    first_row,
    is_number,
    read_text,
    row_number,
    table,
)
from robotctl.logs.formats.times import checked_stamps
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory

_COLUMNS: Final = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_NORM_TOLERANCE: Final = 0.01


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write a trajectory; times have all their nanoseconds, poses a tenth of a micrometre.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    half = 0.5 * trajectory.poses[:, 2]
    rows = zip(
        trajectory.stamps_ns.tolist(),
        trajectory.poses[:, 0].tolist(),
        trajectory.poses[:, 1].tolist(),
        np.sin(half).tolist(),
        np.cos(half).tolist(),
        strict=True,
    )
    text = "".join(
        f"{_seconds(stamp_ns)} {x:.7f} {y:.7f} 0 0 0 {qz:.9f} {qw:.9f}\n"
        for stamp_ns, x, y, qz, qw in rows
    )
    path.write_text(text, encoding="ascii")


def read_tum(path: Path) -> Trajectory:
    """Read a trajectory; its heading is the yaw of the quaternion, the rest is dropped.

    Raises
    ------
    LogFormatError
        If a line is not a pose, a quaternion does not have length 1, a time decreases or is out of
        range, or there is no pose.
    OSError
        If the file cannot be read.
    """
    text = read_text(path)
    rows = table(text, _COLUMNS)
    if len(rows) == 0:
        raise LogFormatError(f"{path}: no pose in it; a line is {' '.join(_COLUMNS)}")
    qx, qy, qz, qw = rows[:, 4:].T
    norm = np.hypot(np.hypot(qx, qy), np.hypot(qz, qw))
    wrong = np.flatnonzero(np.abs(norm - 1.0) > _NORM_TOLERANCE)
    if len(wrong):
        raise LogFormatError(
            f"{path}: pose {wrong[0] + 1}: quaternion of length {norm[wrong[0]]:.3f}, not 1"
        )
    stamps_ns = checked_stamps(
        rows[:, 0],
        "s",
        lambda at, problem: text.error(row_number(text, at), problem),
        can_tell=False,
    )
    back = np.flatnonzero(np.diff(stamps_ns) < 0)
    if len(back):
        raise LogFormatError(f"{path}: pose {back[0] + 2}: its time lies before that of the last")
    theta = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy**2 + qz**2))
    return Trajectory(stamps_ns, np.stack([rows[:, 1], rows[:, 2], theta], axis=1))


def _seconds(stamp_ns: int) -> str:
    """Return a time [ns] as seconds with all its digits."""
    whole, rest = divmod(abs(stamp_ns), 1_000_000_000)
    return f"{'-' if stamp_ns < 0 else ''}{whole}.{rest:09d}"


def _matches(path: Path) -> bool:
    words = first_row(path) if path.is_file() else []
    return len(words) == len(_COLUMNS) and all(map(is_number, words))


def _read(path: Path, _options: ReadOptions) -> Recording:
    return Recording(path.name, reference=read_tum(path))


TUM: Final = LogFormat("a TUM trajectory (for --reference)", _matches, _read, has_time_unit=False)
