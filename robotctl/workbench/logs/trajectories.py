"""The paths of a recording as TUM files, one each, for `evo` and other tools."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robotctl.logs.formats.robotctl_log import read_own
from robotctl.logs.formats.tum import write_tum
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.logs.rows import state_logs


@dataclass(frozen=True, slots=True)
class PathFile:
    """A file that was written."""

    path: Path
    poses: int


def trajectories_of(recording: Recording) -> dict[str, Trajectory]:
    """Return the paths that a recording of ours has, by name.

    `odometry` is `base` in `odom`, `believed` in `world` as the robot's localiser had it, `truth`
    in `world` as the simulator had it.
    """
    found = {
        "odometry": recording.odometry,
        "believed": recording.believed,
        "truth": recording.reference,
    }
    return {name: each for name, each in found.items() if each is not None and len(each.stamps_ns)}


def export_tum(run: Path, folder: Path) -> tuple[list[PathFile], tuple[str, ...]]:
    """Write `odometry.tum`, and `believed.tum` and `truth.tum` where the recording has them.

    Parameters
    ----------
    run
        Folder of `--record`, or one log of it.
    folder
        Made where it is missing.

    Returns
    -------
    tuple
        The files, and sentences on what could not be read.

    Raises
    ------
    RecordingError
        If `run` is none.
    LogFormatError
        If no state is in it.
    OSError
        If a file cannot be read or written.
    """
    state_logs(run)
    recording = read_own(run, with_sonars=False)
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, trajectory in trajectories_of(recording).items():
        path = folder / f"{name}.tum"
        write_tum(path, trajectory)
        files.append(PathFile(path, len(trajectory.stamps_ns)))
    return files, recording.notes
