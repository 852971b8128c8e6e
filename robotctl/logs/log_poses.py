"""Poses of the robot in a recorded drive, by the best source of the log."""

from __future__ import annotations

from pathlib import Path

from robotctl.logs.formats.robotctl_log import truth_files
from robotctl.model.recording import Recording
from robotctl.model.trajectory import Trajectory


def best_poses(log: Path, recording: Recording) -> tuple[Trajectory, str] | None:
    """Return `base` in `world` from a log, and a text naming the source; None: unknown.

    The log's reference, if it has headings, else that of its scans, else the robot's own estimate
    while it was localised.
    """
    if recording.reference is not None and recording.reference_has_heading:
        name = "the simulation's truth" if truth_files(log) else "the log's reference"
        return recording.reference, name
    references = [
        (entry.scan.stamp_ns, entry.reference)
        for entry in recording.scans
        if entry.reference is not None
    ]
    if references:
        stamps_ns, poses = zip(*references, strict=True)
        return Trajectory.of(stamps_ns, poses), "the log's reference"
    if recording.believed is not None:
        return (
            recording.believed,
            "the robot's own localiser, whose errors count as the sensor's",
        )
    return None
