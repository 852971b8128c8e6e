"""Processing of each camera picture, live and in lockstep."""

from __future__ import annotations

import time

import msgspec
import numpy as np
from numpy.typing import NDArray

from robotctl.errors import ConfigError
from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.ground import GroundCamera, GroundView
from robotctl.estimation.camera.markers import MarkerDetector
from robotctl.estimation.camera.obstacles import GroundObstacle
from robotctl.estimation.places.visual.features import features_message
from robotctl.estimation.places.visual.orb import features_of, grey_of
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import CameraView, ImageFeatures, SeenObstacle
from robotctl.model.sensors.camera import CameraConfig, CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry

# Blue, green, red; as unlike as can be.
_WALL = (200, 40, 40)
_THING = (40, 40, 200)
_FEATURES_NS = 250_000_000
"""A keyframe has a picture of its time, so they come more often than keyframes."""


class GroundWatch:
    """Detects the floor, and corners to know places by, and publishes them as messages.

    Another floor than the one that was learnt is not trusted, since a thing that fills the picture
    looks the same. So the floor is learnt again at each arming, when a person can see it.

    Parameters
    ----------
    camera
        Lens and mount.
    settings
        How floor is distinguished from the rest.
    with_features
        Whether somebody recognises places.

    Raises
    ------
    ConfigError
        If the camera sees too little of the floor.
    """

    def __init__(
        self, camera: CameraConfig, settings: GroundCameraConfig, *, with_features: bool = False
    ) -> None:
        self._size = (camera.intrinsics.height_px, camera.intrinsics.width_px)
        try:
            geometry = CameraGeometry.of(camera)
            self._camera = GroundCamera(geometry, settings)
            self._markers: MarkerDetector | None = None
            if camera.markers is not None:
                self._markers = MarkerDetector(geometry, camera.markers)
        except ValueError as error:
            raise ConfigError(f"camera: {error}") from error
        strip = self._camera.strip
        rows = np.minimum(strip.first_rows, len(strip.ranges_m) - 1)
        self._bearings_rad, self._nearest_m = strip.bearings_rad[::-1], strip.ranges_m[rows][::-1]
        self._armings = 0
        self._with_features = with_features
        self._features_due_ns = 0
        _rehearse()

    def attend(self, control: ControlState) -> None:
        """Take in what the robot is at."""
        if control.armings > self._armings:
            self._camera.reset()
        self._armings = control.armings

    def look(self, image_bgr: NDArray[np.uint8], stamp_ns: int) -> CameraView:
        """Return the view of a picture.

        Parameters
        ----------
        image_bgr
            The picture, (height, width, 3).
        stamp_ns
            Its time [ns].
        """
        height, width = image_bgr.shape[:2]
        begin_ns = time.thread_time_ns()
        if (height, width) != self._size:
            return _blind(stamp_ns, f"a picture of {width} x {height} px, not as calibrated")
        view = self._camera.step(image_bgr, stamp_ns)
        markers = () if self._markers is None else self._markers.detect(image_bgr)
        features = self._features(image_bgr, stamp_ns)
        took_us = (time.thread_time_ns() - begin_ns) / 1000.0
        nearest = np.interp(view.scan.angles_rad, self._bearings_rad, self._nearest_m)
        return msgspec.structs.replace(
            camera_view(view, nearest, took_us), markers=markers, features=features
        )

    def _features(self, image_bgr: NDArray[np.uint8], stamp_ns: int) -> ImageFeatures | None:
        """Return the corners of a picture, if it is time."""
        if not self._with_features or stamp_ns < self._features_due_ns:
            return None
        self._features_due_ns = stamp_ns + _FEATURES_NS
        return features_message(features_of(grey_of(image_bgr)))


def _rehearse() -> None:
    """Compile, or load from the cache, all that any picture needs: that takes seconds.

    By a small camera of its own: what is compiled depends on no lens, no mount and no setting, but
    only before a wall and a thing is all of it reached.
    """
    lens = CameraIntrinsics(320, 240, 250.0, 250.0, 159.5, 119.5)
    camera = GroundCamera(
        CameraGeometry(lens, CameraMount(0.0, 0.0, 0.3, 0.0, 20.0, 0.0)), GroundCameraConfig()
    )
    picture = np.random.default_rng(0).integers(90, 110, (240, 320, 3), dtype=np.uint8)
    picture[:50] = _WALL
    picture[75:110, 140:180] = _THING
    for _ in range(2):
        camera.step(picture, 0)


def camera_view(view: GroundView, nearest_m: NDArray[np.float64], step_us: float) -> CameraView:
    """Return a view as a message; floor nearer than `nearest_m` (n,) is not in sight."""
    scan = view.scan
    sigmas = np.full(len(scan.ranges_m), np.nan) if scan.sigmas_m is None else scan.sigmas_m
    return CameraView(
        stamp_ns=scan.stamp_ns,
        x_m=float(scan.x_m),
        y_m=float(scan.y_m),
        max_range_m=float(scan.max_range_m),
        angles_rad=tuple(scan.angles_rad.tolist()),
        ranges_m=tuple(scan.ranges_m.tolist()),
        sigmas_m=tuple(sigmas.tolist()),
        nearest_m=tuple(nearest_m.tolist()),
        obstacles=tuple(map(_seen, view.obstacles)),
        trouble=view.why,
        step_us=step_us,
    )


def _seen(obstacle: GroundObstacle) -> SeenObstacle:
    """Return an object on the floor as a message."""
    (xx, xy), (_, yy) = obstacle.foot_covariance.tolist()
    x_m, y_m = obstacle.foot_base.tolist()
    return SeenObstacle(x_m, y_m, (xx, xy, yy), float(obstacle.width_m))


def _blind(stamp_ns: int, trouble: str) -> CameraView:
    """Return the view of an unusable picture."""
    return CameraView(stamp_ns, 0.0, 0.0, 1.0, (), (), (), (), trouble=trouble)
