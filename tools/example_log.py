"""Write the log of examples/data: the patrol of the simulated robot with a lidar, as CARMEN log.

A stand-in for recordings of real robots, which are not ours to pass on: two scans a second of
181 beams, at the poses of the odometry and, as a reference, at the true ones.
"""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from robotctl.app.simulation.lockstep import run_lockstep
from robotctl.app.simulation.sim_options import SimOptions
from robotctl.config.robot_file import find_file
from robotctl.logs.formats.recorded_log import read_recording
from robotctl.model.geometry.se2 import SE2
from robotctl.model.recording import RecordedScan, Recording

LOG = Path(__file__).resolve().parents[1] / "examples" / "data" / "patrol.log.gz"
EVERY = 4
"""So many scans of the lidar, eight a second, for one of the log."""


def drive(folder: Path) -> Recording:
    """Drive the patrol in lockstep and return what was recorded."""
    run_lockstep(
        SimOptions(
            find_file("diff_drive"),
            find_file("patrol", "missions"),
            seed=3,
            record=folder,
            localisation=('localisation.method="mcl"', 'localisation.sensors=["lidar"]'),
        ),
        print,
    )
    return read_recording(folder)


def lines(recording: Recording) -> Iterator[str]:
    """Yield the lines of the log."""
    reach_m = recording.scans[0].scan.max_range_m
    yield "# CARMEN Logfile: a simulated robot on its patrol, by tools/example_log.py"
    yield f"PARAM robot_front_laser_max {reach_m:.1f}"
    for each in recording.scans[::EVERY]:
        yield _flaser(each, reach_m)


def _flaser(each: RecordedScan, reach_m: float) -> str:
    """Return the line of a scan: the beams from right to left."""
    scan, reference = each.scan, each.reference
    if reference is None:
        raise ValueError("a simulated run has a reference")
    ahead = np.abs(scan.angles_rad) < np.radians(90.5)
    ranges_m = np.nan_to_num(scan.ranges_m[ahead], nan=reach_m, posinf=reach_m)
    ranges = " ".join(f"{value:.2f}" for value in ranges_m)
    poses = f"{_pose(reference)} {_pose(each.odometry)}"
    time = f"{scan.stamp_ns * 1e-9:.3f}"
    return f"FLASER {len(ranges_m)} {ranges} {poses} {time} robotctl {time}"


def _pose(pose: SE2) -> str:
    return f"{pose.x_m:.4f} {pose.y_m:.4f} {pose.theta_rad:.5f}"


def main() -> None:
    """Drive, and write the log; the same run gives the same bytes."""
    with tempfile.TemporaryDirectory() as folder:
        text = "".join(f"{line}\n" for line in lines(drive(Path(folder))))
    LOG.write_bytes(gzip.compress(text.encode("ascii"), mtime=0))
    print(f"{LOG}: {LOG.stat().st_size} bytes")


if __name__ == "__main__":
    main()
