"""Step: remaining calibrations on the floor, with their commands."""

from __future__ import annotations

from robotctl.deploy.setup.bench import Bench
from robotctl.deploy.setup.dialogue import NO_CHANGES, Script, Tell


def run(bench: Bench) -> Script:
    """Show the commands for odometry, lidar and camera, as far as this robot has them."""
    config = bench.config
    yield Tell(
        "Odometry: drive a square in each direction, measure by tape, and `robotctl calibrate "
        "odometry --runs FILE` finds wheels and track: docs/calibration.md."
    )
    if config.lidars:
        yield Tell("Lidar: `robotctl doctor` sees its scans; its mount is [lidar].")
    if config.camera is not None:
        yield Tell("Camera: `robotctl camera calibrate`, then `camera check`: docs/camera.md.")
    yield Tell("At last: `robotctl doctor`, and `robotctl run`.")
    return NO_CHANGES
