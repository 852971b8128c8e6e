"""A recorded drive as values, independent of the format of its file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan
from robotctl.model.sensors.sonar import SonarMount, SonarReading
from robotctl.model.trajectory import Trajectory

UNKNOWN_LANDMARK: Final = -1
"""Id of a sighting of an unknown landmark."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """A scan with the robot's logged poses at its time.

    Parameters
    ----------
    scan
        Scan.
    odometry
        Pose of `base` in the frame of the odometry.
    reference
        Pose of `base` in `world`; None if the log has none.
    """

    scan: RangeScan
    odometry: SE2
    reference: SE2 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSonar:
    """Readings of sonars of a ring at one time, with the robot's logged pose.

    Parameters
    ----------
    reading
        Ranges; also nan if the log does not have them.
    odometry
        Pose of `base` in the frame of the odometry.
    """

    reading: SonarReading
    odometry: SE2


@dataclass(frozen=True, slots=True)
class Sighting:
    """A landmark seen at a range [m] and bearing [rad, from forward to the left] of `base`."""

    stamp_ns: int
    landmark: int
    range_m: float
    bearing_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recorded drive; fields that a format does not have are empty or None.

    Parameters
    ----------
    name
        Name of the log, for messages.
    scans
        Scans in the order of their times.
    odometry
        Poses in the frame of the odometry; None if the log has velocities only.
    gyro_turns_rad
        Turn that a gyro instead of the wheels has contributed to the odometry up to each of its
        poses, (n,) [rad]; (0,) for odometry of the wheels alone.
    twist_stamps_ns, twists
        Times, (m,), from which v [m/s] and omega [rad/s] of `base`, (m, 2), hold; m may be 0.
    reference
        Poses of `base` in `world`, from a source better than odometry.
    reference_has_heading
        Whether the reference has headings; else its theta is 0 and meaningless.
    believed
        Poses of `base` in `world` by the robot's own localiser, while it was localised; None if the
        log has none.
    sightings
        Sightings of landmarks, in the order of their times.
    landmarks
        Position of each known landmark in `world` [m].
    wheel_ticks
        Time [ns] and cumulative counts of the left and of the right wheel, (n, 3); n may be 0.
    sonars
        Readings of sonars in the order of their times.
    sonar_mounts
        Mounting of the sonars; empty if the log does not have it.
    views
        Ranges to the floor's boundary, as a camera saw it, in the order of their times.
    notes
        Sentences for people: omissions and assumptions of the reader.
    """

    name: str
    scans: tuple[RecordedScan, ...] = ()
    odometry: Trajectory | None = None
    gyro_turns_rad: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    twist_stamps_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    twists: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    reference: Trajectory | None = None
    reference_has_heading: bool = True
    believed: Trajectory | None = None
    sightings: tuple[Sighting, ...] = ()
    landmarks: dict[int, tuple[float, float]] = field(default_factory=dict)
    wheel_ticks: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 3), np.int64))
    sonars: tuple[RecordedSonar, ...] = ()
    sonar_mounts: tuple[SonarMount, ...] = ()
    views: tuple[RecordedScan, ...] = ()
    notes: tuple[str, ...] = ()

    def why(self) -> str:
        """Return the notes as lines that follow a message on missing data."""
        return "".join(f"\nnote: {note}" for note in self.notes)
