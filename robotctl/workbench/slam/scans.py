"""`robotctl slam --sensor NAME`: trajectory and map of a recorded drive, by scans."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from robotctl.errors import RobotctlError
from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.localisation_config import LocalisationConfig
from robotctl.estimation.ranging.merging import ScanMerger
from robotctl.estimation.sensor_names import LIDAR
from robotctl.estimation.sensors.sensor import SensedRobot
from robotctl.estimation.slam.front_end.surface import surface_of
from robotctl.estimation.slam.keyframes.config import KeyframeConfig
from robotctl.estimation.slam.keyframes.heard_places import HeardPlaces
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.motion import ScanPose
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap
from robotctl.estimation.slam.keyframes.tracker import LEAST_ECHOES
from robotctl.estimation.slam.local_scans.own_motion import OwnMotion
from robotctl.estimation.slam.local_scans.registry import load_source
from robotctl.estimation.slam.local_scans.source import ScanSource
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.estimation.slam.verdict.map_check import breaks, shifts_of
from robotctl.estimation.slam.verdict.odometry_check import OdometryCheck
from robotctl.estimation.slam.verdict.verdict import RunFigures, Verdict, verdict_of
from robotctl.logs.formats.image_folder import TimedImage
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.logs.formats.recorded_log import has_odometry, read_recording
from robotctl.logs.formats.robotctl_log import ROBOTCTL
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording
from robotctl.model.trajectory import Trajectory
from robotctl.runtime.heap import map_large_arrays
from robotctl.words import counted
from robotctl.workbench.slam.result import Estimated

if TYPE_CHECKING:
    from robotctl.workbench.places.images import MatchedImages
    from robotctl.workbench.slam.pictures import ShownPictures

Progress: TypeAlias = Callable[[int, int], None]

_AT_ONCE: Final = 256
_LOOK_M: Final = 0.4
"""Way after which a lost robot is looked for again [m]."""


class ScanSlamError(RobotctlError):
    """A log has nothing of a sensor, or its map is not one."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanResult:
    """A drive after SLAM by scans.

    Parameters
    ----------
    recording
        The log, with the scans that were matched.
    mapper
        With keyframes, graph and closures.
    estimate, online
        Poses of all scans: with all that was seen, and as they were known at once.
    grid
        The map, of all scans.
    has_odometry
        Whether the log has odometry of its own.
    times_ms
        CPU time of each scan, (n,) [ms].
    grid_ms
        CPU time of the map [ms].
    frame
        The map's frame in `world`.
    images
        What the images of keyframes were recognised as; None: there are none.
    place
        Where the robot was at the end.
    verdict
        How good the map is, as far as the run itself shows; None of stretches, which odometry holds
        together: they say nothing of it.
    sensor
        Of the scans.
    """

    recording: Recording
    mapper: SlamMapper
    estimate: Trajectory
    online: Trajectory
    grid: OccupancyGrid
    has_odometry: bool
    times_ms: np.ndarray
    grid_ms: float
    frame: SE2
    place: ScanPose
    verdict: Verdict | None
    images: MatchedImages | None = None
    sensor: str = LIDAR

    def report(self) -> dict[str, Any]:
        """Return the figures; the keys stand in docs/slam.md."""
        back_end, log = self.mapper.back_end, self.mapper.loops.log
        reference = self.recording.reference
        off = sum(weight < OFF for weight in back_end.weights)
        closed = [each for each in log if not each.reason]
        figures, verdict = self.grid.figures(), self.verdict
        images: dict[str, Any] = {}
        if self.images is not None:
            refusals = [each.refusal for each in self.images.recognitions]
            images["images"] = {
                "looked_at": len(refusals),
                "recognised": refusals.count(""),
                "refused": dict(Counter(each for each in refusals if each)),
            }
        return {
            "log": self.recording.name,
            "verdict": None if verdict is None else verdict.quality.value,
            "reasons": [] if verdict is None else list(verdict.reasons),
            "notes": list(self.recording.notes),
            "scans": len(self.recording.scans),
            "odometry": self.has_odometry,
            **self._tracking(),
            "keyframes": len(self.mapper.keyframes),
            "links": len(back_end.links),
            "links_of_loops": int(np.count_nonzero(back_end.links.is_loop)),
            "switched_off": off,
            "loops": {
                "closed": len(closed),
                "closed_by": dict(Counter(each.found_by for each in closed)),
                "refused": dict(Counter(each.reason for each in log if each.reason)),
            },
            **images,
            "trajectory": Estimated(self.estimate).compared(reference),
            "online": Estimated(self.online).compared(reference),
            "map": {
                "seen_m2": figures.seen_m2,
                "mean_entropy_bits": figures.mean_entropy_bits,
            },
            "time_ms": {
                "scans": float(self.times_ms.sum()),
                "mean": float(self.times_ms.mean()),
                "p99": float(np.percentile(self.times_ms, 99.0)),
                "max": float(self.times_ms.max()),
                "grid": self.grid_ms,
            },
        }

    def _tracking(self) -> dict[str, Any]:
        """Return the figures of the registration; nothing speaks of wheels without odometry."""
        tracker, robot = self.mapper.tracker, self.mapper.robot
        return {
            "slips": tracker.slips if self.has_odometry else None,
            "odometry_left_out": robot.trust.losses if self.has_odometry else None,
            "unmeasured_m": robot.unmeasured_m,
            "unseen_m": tracker.unseen_m,
            "ambiguous": tracker.ambiguous,
            "unmatched": tracker.unmatched,
        }


def scan_slam(
    log: Path,
    time_unit: str | None,
    progress: Progress,
    onto: Path | None = None,
    sensor: str = LIDAR,
    images: Path | None = None,
    sweep_s: float | None = None,
) -> ScanResult:
    """Make trajectory and map of a log; with `onto`, go on with that map of keyframes.

    By lidar the log may begin anywhere on that, by others where the map's drive ended. With
    `images`, a folder, places are recognised by these, too. `sweep_s` is as of `read_recording`.

    Raises
    ------
    RobotctlError
        If log or map cannot be read, the log has no scans, or is not found on the map; if that was
        made by another sensor.
    OSError
        If a file cannot be read.
    """
    map_large_arrays()
    recording = read_recording(log, time_unit=time_unit, sweep_s=sweep_s)
    recording, source = _scanned(recording, sensor, log)
    first = next(
        (row for row, each in enumerate(recording.scans) if _echoes(each) >= LEAST_ECHOES), None
    )
    if first is None:
        raise ScanSlamError(
            f"{log}: {len(recording.scans)} {sensor} scans in it, none with {LEAST_ECHOES} echoes, "
            f"which --sensor {sensor} needs{recording.why()}"
        )
    if first:
        note = f"{counted(first, 'scan')} left out, before the first with {LEAST_ECHOES} echoes"
        recording = replace(
            recording, scans=recording.scans[first:], notes=(*recording.notes, note)
        )
    pictures: Sequence[TimedImage] = ()
    if images is not None:
        from robotctl.workbench.slam.pictures import pictures_of  # noqa: PLC0415 - OpenCV

        pictures = pictures_of(images, recording.scans)
    saved = None if onto is None else _map_by(sensor, onto)
    if saved is not None and sensor == LIDAR:
        return scan_slam_onto(recording, saved, progress, pictures)
    result = scan_slam_of(recording, progress, source.config, pictures, saved)
    return replace(result, sensor=sensor)


def _map_by(sensor: str, file: Path) -> KeyframeMap:
    """Return the map of keyframes in a file; raises if none by that sensor is in it."""
    saved = load_keyframes(file)
    if saved is None:
        raise ScanSlamError(f"{file}: no map of keyframes")
    if saved.sensor != sensor:
        raise ScanSlamError(f"{file}: a map made by {saved.sensor}, needed is one by {sensor}")
    return saved


def _scanned(recording: Recording, sensor: str, log: Path) -> tuple[Recording, ScanSource[Any]]:
    """Return a recording with the scans of a sensor, and the source that made them."""
    source = load_source(sensor)
    if sensor == LIDAR:
        return _joined(recording), source
    measured = source.recorded(recording)
    if not measured:
        raise ScanSlamError(
            f"{log}: nothing of a {sensor} in it, which --sensor {sensor} needs; it has "
            f"{_sensors_of(recording)}"
        )
    try:
        robot = SensedRobot(recording.sonar_mounts, LocalisationConfig(), bool(recording.views))
        maker = source.maker(robot)
    except ValueError as error:
        raise ScanSlamError(f"{log}: {error}; {ROBOTCTL.name} says it") from error
    scans = [scan for each, odometry in measured for scan in maker.add(each, odometry)]
    return replace(recording, scans=tuple(scans)), source


def _joined(recording: Recording) -> Recording:
    """Return a recording whose scans are views of all its lidars."""
    scans, by_wheels = recording.scans, has_odometry(recording.scans)
    counts = Counter(each.scan.name for each in scans)
    if len(counts) < 2:
        return recording
    leader = counts.most_common(1)[0][0]
    merger, views = ScanMerger(leader), list[RecordedScan]()
    for each in sorted(scans, key=lambda one: (one.scan.stamp_ns, one.scan.name == leader)):
        view = merger.add(each.scan, each.odometry if by_wheels else SE2())
        views += [] if view is None else [replace(each, scan=view)]
    note = f"scans of {len(counts)} lidars, joined at those of {leader or 'the first'}"
    return replace(recording, scans=tuple(views), notes=(*recording.notes, note))


def _sensors_of(recording: Recording) -> str:
    """Return of which sensors a recording has something, for messages."""
    counts = {"lidar scans": recording.scans, "readings of sonars": recording.sonars}
    counts["views of a camera"] = recording.views
    found = [f"{len(each)} {name}" for name, each in counts.items() if each]
    return " and ".join(found) or "no sensor that --sensor knows"


def _echoes(each: RecordedScan) -> int:
    """Return how many echoes a scan has."""
    return len(surface_of(each.scan).points)


def scan_slam_of(
    recording: Recording,
    progress: Progress,
    config: KeyframeConfig | None = None,
    pictures: Sequence[TimedImage] = (),
    after: KeyframeMap | None = None,
) -> ScanResult:
    """Map a recording, whose first scan has `LEAST_ECHOES` echoes.

    With `after`, by stretches: go on with that map where its drive ended.
    """
    _compile(recording)
    count, by_wheels = len(recording.scans), has_odometry(recording.scans)
    mapper = SlamMapper(config)
    if after is not None:
        mapper.resume(after, is_there=True)
        mapper.restart_segment(
            ScanPose(0, *after.place), recording.scans[0].odometry, is_another=True
        )
    drive = _Drive(mapper, recording, by_wheels, after, pictures)
    for row in range(count):
        drive.add(row)
        progress(row + 1, count)
    drive.mapper.finish()
    return drive.result()


def scan_slam_onto(
    recording: Recording,
    saved: KeyframeMap,
    progress: Progress,
    pictures: Sequence[TimedImage] = (),
) -> ScanResult:
    """Go on with a map: from the first scan that is found on it to the end, then to the begin.

    Raises
    ------
    ScanSlamError
        If no scan is found.
    """
    _compile(recording)
    count, by_wheels = len(recording.scans), has_odometry(recording.scans)
    mapper = SlamMapper(KeyframeConfig(is_live=True))
    mapper.resume(saved, is_there=False)
    drive, first, row = _Drive(mapper, recording, by_wheels, saved, pictures), 0, 0
    while not mapper.is_sure:
        if row == count:
            raise ScanSlamError(
                f"{recording.name}: none of its {count} scans is found for sure on the map of "
                f"{len(saved.keyframes)} scans"
            )
        found = mapper.relocaliser.found
        drive.add(row)
        first = row if mapper.relocaliser.found > found else first
        row += 1
    for later in range(row, count):
        drive.add(later)
        progress(later - first, count)
    mapper.robot.relocate(
        drive.places[first], recording.scans[first].odometry if by_wheels else None
    )
    for earlier in range(first - 1, -1, -1):
        drive.add(earlier)
        progress(count - earlier, count)
    mapper.finish()
    return drive.result()


class _Drive:
    """Scans of a recording on their way through a mapper."""

    def __init__(
        self,
        mapper: SlamMapper,
        recording: Recording,
        by_wheels: bool,
        saved: KeyframeMap | None = None,
        pictures: Sequence[TimedImage] = (),
    ) -> None:
        self.mapper = mapper
        self._pictures: ShownPictures | None = None
        if pictures:
            from robotctl.workbench.slam.pictures import ShownPictures  # noqa: PLC0415 - OpenCV

            self._pictures = ShownPictures(pictures, mapper)
        self._heard: HeardPlaces | None = None
        if recording.sonars and recording.sonar_mounts:
            self._heard = HeardPlaces(recording.sonar_mounts, mapper.loops)
        self._sonars = iter(recording.sonars)
        self._sonar = next(self._sonars, None)
        self._saved = saved
        self._looked: SE2 | None = None
        self._recording = recording
        self._scans = [each.scan for each in recording.scans]
        self._own_motion = None if by_wheels else OwnMotion()
        count = len(recording.scans)
        self.places = [ScanPose(0, 0, SE2())] * count
        self._online = [SE2()] * count
        self._times_ms = np.zeros(count)

    def add(self, row: int) -> None:
        """Take a scan; look for it on the whole map, if the robot is lost on one."""
        mapper, each = self.mapper, self._recording.scans[row]
        began_ns = time.process_time_ns()
        if self._own_motion is None:
            mapper.add(each.scan, each.odometry)
        else:
            self._scans[row] = self._own_motion.straight(each.scan)
            mapper.add(self._scans[row])
        if mapper.relocaliser.is_searching and _is_away(self._looked, mapper.pose):
            while mapper.relocaliser.is_searching and not mapper.relocalise():
                pass
            self._looked = mapper.pose
        if self._pictures is not None:
            self._pictures.show_new()
        if self._heard is not None:
            self._hear(self._heard, each)
        self.places[row], self._online[row] = mapper.place, mapper.pose
        self._times_ms[row] = 1e-6 * (time.process_time_ns() - began_ns)

    def _hear(self, heard: HeardPlaces, scan: RecordedScan) -> None:
        """Take the sonars' readings up to a scan, and see whether they know the place."""
        while self._sonar is not None and self._sonar.reading.stamp_ns <= scan.scan.stamp_ns:
            heard.hear(self._sonar.reading, self._sonar.odometry)
            self._sonar = next(self._sonars, None)
        heard.look(self.mapper.place, scan.odometry)

    def result(self) -> ScanResult:
        """Return all of it."""
        mapper, scans = self.mapper, self._scans
        stamps_ns = [each.stamp_ns for each in scans]
        poses = [mapper.back_end.pose(each.keyframe) @ each.pose for each in self.places]
        estimate = Trajectory.of(stamps_ns, poses)
        began_ns = time.process_time_ns()
        drawn, placed = scans, estimate.poses
        if self._saved is not None:
            drawn = [each.scan for each in mapper.keyframes]
            placed = mapper.back_end.poses
        grid = OccupancyGrid()
        for begin in range(0, len(drawn), _AT_ONCE):
            end = begin + _AT_ONCE
            grid.update_scans(placed[begin:end], drawn[begin:end])
        grid_ms = 1e-6 * (time.process_time_ns() - began_ns)
        notes = () if self._pictures is None else self._pictures.notes
        matched = zip(self._recording.scans, scans, strict=True)
        return ScanResult(
            replace(
                self._recording,
                scans=tuple(replace(each, scan=scan) for each, scan in matched),
                notes=(*self._recording.notes, *notes),
            ),
            mapper,
            estimate,
            Trajectory.of(stamps_ns, self._online),
            grid,
            self._own_motion is None,
            self._times_ms,
            grid_ms,
            SE2() if self._saved is None else self._saved.frame,
            self._end(),
            None if mapper.config.stretch_m else self._verdict(estimate),
            None if self._pictures is None else self._pictures.matched,
        )

    def _verdict(self, estimate: Trajectory) -> Verdict:
        """Return the verdict on the map, after the last scan."""
        mapper, scans, check = self.mapper, self._recording.scans, OdometryCheck()
        for scan, row in zip(scans, estimate.poses.tolist(), strict=True):
            check.add(scan.odometry, SE2(*row))
        figures = check.figures() if self._own_motion is None else None
        return verdict_of(
            RunFigures(
                len(scans),
                mapper.tracker.unmatched,
                mapper.tracker.ambiguous,
                shifts_of(mapper.growing),
                figures,
                len(breaks(mapper.growing)),
            ),
            mapper.config.tuning.verdict,
        )

    def _end(self) -> ScanPose:
        """Return where the robot was at the end: the last stretch is that of its middle."""
        place, odometry = self.mapper.place, self._recording.odometry
        if not self.mapper.config.stretch_m or odometry is None:
            return place
        last, end = self._recording.scans[-1].odometry, SE2(*odometry.poses[-1].tolist())
        return replace(place, pose=place.pose @ last.inverse() @ end)


def _is_away(before: SE2 | None, now: SE2) -> bool:
    """Return whether a lost robot may see something new."""
    return before is None or float(np.hypot(now.x_m - before.x_m, now.y_m - before.y_m)) > _LOOK_M


def _compile(recording: Recording) -> None:
    """Have all kernels compiled before times are taken."""
    mapper = SlamMapper(KeyframeConfig(keyframe_m=0.0))
    for _ in range(mapper.config.linked_keyframes + 2):
        mapper.add(recording.scans[0].scan, SE2())
