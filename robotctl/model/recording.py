"""A recorded drive as values, whatever the format of its file."""

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
    """A scan with the log's data on the robot at its time.

    Parameters
    ----------
    scan
        Ranges.
    odometry
        `base` in the frame of the odometry.
    reference
        `base` in `world`; None if the log has none.
    """

    scan: RangeScan
    odometry: SE2
    reference: SE2 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RecordedSonar:
    """Readings of sonars of a ring at one time, with the log's data on the robot.

    Parameters
    ----------
    reading
        Ranges; nan also if the log does not have them.
    odometry
        `base` in the frame of the odometry.
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
        Of the log, for messages.
    scans
        In the order of their times.
    odometry
        Poses in the frame of the odometry; None if the log has velocities only.
    gyro_turns_rad
        By how much a gyro, and not the wheels, has turned the odometry up to each of its poses,
        (n,) [rad]; (0,) where it is of the wheels alone.
    twist_stamps_ns, twists
        (m,) and (m, 2): from this time on, v [m/s] and omega [rad/s] of `base`; m may be 0.
    reference
        `base` in `world`, from something better than odometry.
    reference_has_heading
        False if the reference is positions only; its theta is 0 then and means nothing.
    believed
        `base` in `world` by the robot's own localiser, while it was localised; None if the log
        has none.
    sightings
        Of landmarks, in the order of their times.
    landmarks
        Position of each known landmark in `world` [m].
    wheel_ticks
        (n, 3): time [ns], cumulative counts of the left and of the right wheel; (0, 3) where none.
    sonars
        In the order of their times.
    sonar_mounts
        Mounting of the sonars; empty if the log does not have it.
    views
        Ranges to the floor's boundary, as a camera saw it, in the order of their times.
    notes
        Sentences for people: what the reader left out or had to assume.
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
        """Return the notes as lines that follow a message on what the recording lacks."""
        return "".join(f"\nnote: {note}" for note in self.notes)
