"""`robotctl slam`: trajectory and map of a recorded drive, by what it saw."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeAlias, cast

import numpy as np

from robotctl.errors import ConfigError, RobotctlError
from robotctl.estimation.landmarks.config import LandmarkConfig
from robotctl.estimation.landmarks.localisation import CountedOdometry
from robotctl.estimation.slam.ekf_slam.bookkeeping import Association
from robotctl.estimation.slam.ekf_slam.joined_maps import MOST_FEATURES
from robotctl.estimation.slam.ekf_slam.recorded import RecordedSlam
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.logs.formats.plaza_log import is_range_log, read_range_log
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.logs.formats.tum import write_tum
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.graph_files import GRAPH_FORMATS, read_graph
from robotctl.logs.recorded_motion import known_from_ns, start_pose
from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.pose_estimate import PoseEstimate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import UNKNOWN_LANDMARK, Recording
from robotctl.model.trajectory import Trajectory
from robotctl.workbench.slam.graphs import slam_of_graph, smoothed
from robotctl.workbench.slam.options import SlamOptions
from robotctl.workbench.slam.ranges import slam_of_ranges
from robotctl.workbench.slam.recorded_graph import graph_of_recording
from robotctl.workbench.slam.result import Estimated, Landmarks, SlamResult

Progress: TypeAlias = Callable[[int, int], None]

_TOLD: Final = 1000


class SlamError(RobotctlError):
    """A log has not what SLAM needs."""


def slam(options: SlamOptions, progress: Progress) -> SlamResult:
    """Make trajectory and map of a log.

    Raises
    ------
    RobotctlError
        If the log cannot be read, or has no motion or no sightings.
    OSError
        If a file cannot be read.
    """
    log = options.log
    is_graph = log.is_file() and any(each.matches(log) for each in GRAPH_FORMATS)
    if is_range_log(log):
        if options.solver in ("ekf", "submaps"):
            raise ConfigError(f"--solver {options.solver}: {log} has ranges only; graph is allowed")
        return smoothed(slam_of_ranges(log.name, read_range_log(log)))
    if is_graph:
        if options.association != "names":
            raise ConfigError(
                f"--association {options.association}: {log} is a graph, which says what is seen; "
                "only names is possible"
            )
        try:
            most = MOST_FEATURES if options.solver == "submaps" else None
            result = slam_of_graph(log.name, read_graph(log), progress, most)
        except ValueError as error:
            raise SlamError(f"{log}: {error}; robotctl optimise solves any graph") from error
    elif options.solver == "submaps":
        raise ConfigError(
            f"--solver submaps: {log} is no graph; the filter of recordings calibrates their "
            "sensors, which couples all local maps. Allowed here are ekf and graph"
        )
    else:
        recording = read_recording(
            log, options.mrclam_robot, with_sonars=False, time_unit=options.time_unit
        )
        result = slam_of_recording(recording, options, progress)
    is_smoothed = options.solver == "graph" or (is_graph and not options.solver)
    return smoothed(result) if is_smoothed else result


def slam_of_recording(recording: Recording, options: SlamOptions, progress: Progress) -> SlamResult:
    """Filter along a recording; raises `SlamError`."""
    if not recording.sightings:
        raise SlamError(
            f"{options.log}: no sightings of landmarks in it, which --features landmarks needs; "
            f"a MRCLAM folder has them{recording.why()}"
        )
    if options.association == "names" and any(
        each.landmark == UNKNOWN_LANDMARK for each in recording.sightings
    ):
        raise SlamError(
            f"{options.log}: its landmarks have no names; use --association joint or nearest"
        )
    config = LandmarkConfig()
    try:
        start = _start(recording, config)
    except ValueError as error:
        raise SlamError(f"{options.log}: {error}") from error
    drive = RecordedSlam(recording, config, start, cast("Association", options.association))
    began_ns = time.process_time_ns()
    online = []
    for step in drive.steps():
        online.append(step.estimate)
        progress(round(_TOLD * step.share), _TOLD)
    spent_ms = 1e-6 * (time.process_time_ns() - began_ns)
    marks = _landmarks(drive)
    graph, stamps_ns = graph_of_recording(drive, start, marks.names)
    return SlamResult(
        recording.name,
        Estimated(
            Trajectory(np.array(stamps_ns, np.int64), graph.values[POSES]),
            np.searchsorted(stamps_ns, drive.past_ns),
            drive.past(),
        ),
        Estimated(
            Trajectory.of((each.stamp_ns for each in online), (each.pose for each in online)),
            np.arange(len(online)),
            np.array([each.covariance for each in online]),
        ),
        marks,
        graph,
        recording.reference if recording.reference_has_heading else None,
        recording.landmarks,
        {
            "association": options.association,
            "sightings": {"used": len(drive.seen), "unused": drive.book.unused},
            "time_ms": {"filter": spent_ms},
        },
        recording.notes,
    )


def _start(recording: Recording, config: LandmarkConfig) -> PoseEstimate:
    """Return where the drive begins: at the reference if there is one, as near as it is known."""
    begin_ns = max(CountedOdometry(recording).begin_ns, known_from_ns(recording))
    if recording.reference is not None:
        begin_ns = max(begin_ns, int(recording.reference.stamps_ns[0]))
    pose = start_pose(recording, begin_ns) if recording.reference_has_heading else None
    sigma = np.array([config.map_sigma_m, config.map_sigma_m, config.map_sigma_rad])
    if pose is None:
        pose, sigma = SE2(), np.full(3, 1e-6)
    return PoseEstimate(begin_ns, pose, np.diag(sigma**2), LocalisationStatus.LOCALISED)


def _landmarks(drive: RecordedSlam) -> Landmarks:
    """Return the map of a filter."""
    slam, counts = drive.run.slam, drive.book.counts
    numbers = [slam.names.index(name) for name in counts]
    return Landmarks(
        tuple(counts),
        slam.features[numbers],
        np.array([slam.covariance(number) for number in numbers]).reshape(-1, 2, 2),
        tuple(counts.values()),
    )


def write_results(result: SlamResult, folder: Path) -> None:
    """Write trajectory.tum, online.tum, landmarks.csv, graph.g2o and report.json into a folder.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    write_tum(folder / "trajectory.tum", result.estimate.trajectory)
    if result.online is not None:
        write_tum(folder / "online.tum", result.online.trajectory)
    marks = result.landmarks
    lines = ["name,x_m,y_m,var_x_m2,cov_xy_m2,var_y_m2,sightings"]
    for name, (x, y), P, count in zip(
        marks.names, marks.positions.tolist(), marks.covariances, marks.sightings, strict=True
    ):
        lines.append(f"{name},{x:.6f},{y:.6f},{P[0, 0]:.6g},{P[0, 1]:.6g},{P[1, 1]:.6g},{count}")
    (folder / "landmarks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    G2O.write(folder / "graph.g2o", result.graph)
    text = json.dumps(result.report(), indent=2) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")
