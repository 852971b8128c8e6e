"""`robotctl camera check`: markers at known places against the calibration's estimates."""

from __future__ import annotations

import math
from dataclasses import dataclass

from robotctl.config.robot_file import camera_of, load_robot
from robotctl.estimation.camera.calibration.errors import Band, FloorErrors, bands, floor_errors
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.workbench.camera.correspondences import FloorPoints, clicked_points, markers_seen
from robotctl.workbench.camera.options import CheckOptions
from robotctl.workbench.camera.pictures import read_picture_of


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of a check.

    Parameters
    ----------
    options
        The options.
    camera
        As calibrated.
    points
        The known places and their pixels.
    errors, bands
        For each point, and by distance.
    """

    options: CheckOptions
    camera: CameraGeometry
    points: FloorPoints
    errors: FloorErrors
    bands: tuple[Band, ...]

    @property
    def doubts(self) -> list[str]:
        """Objections to the calibration; empty: none."""
        above = [
            name
            for name, told in zip(self.points.names, self.errors.told, strict=True)
            if math.isnan(told[0])
        ]
        doubts = [f"{', '.join(above)}: not on the floor, according to the camera"] if above else []
        doubts += [
            f"{band.low_m:g} to {band.high_m:g} m: errors of {1e3 * band.rmse_m:.0f} mm, "
            f"{1e3 * band.expected_m:.0f} mm expected"
            for band in self.bands
            if band.surprising
        ]
        return doubts


def check_camera(options: CheckOptions) -> CheckResult:
    """Compare known places with the camera's estimates.

    Raises
    ------
    ConfigError
        If a file is wrong.
    CalibrationError
        If no marker is seen.
    OSError
        If a file cannot be read.
    """
    config = camera_of(load_robot(options.robot, options.overrides), options.robot)
    camera = CameraGeometry.of(config)
    points = FloorPoints.none()
    if options.points is not None:
        points = points.joined(clicked_points(options.points))
    if options.picture is not None and options.markers is not None:
        picture = read_picture_of(options.picture, config.intrinsics)
        points = points.joined(markers_seen(picture, options.markers, options.family))
    errors = floor_errors(camera, points.ground, points.pixels, options.noise)
    return CheckResult(options, camera, points, errors, bands(errors))
