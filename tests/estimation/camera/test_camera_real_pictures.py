"""Real pictures, of which nothing is known but that they show a floor: nothing breaks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from robotctl.estimation.camera.config import GroundCameraConfig
from robotctl.estimation.camera.ground import GroundCamera
from robotctl.model.sensors.camera import CameraIntrinsics, CameraMount
from robotctl.model.sensors.camera_geometry import CameraGeometry

# Lens and mount of the recording are not known: these put the horizon where corridors vanish.
LENS = CameraIntrinsics(512, 384, 420.0, 420.0, 255.5, 191.5)
CAMERA = CameraGeometry(LENS, CameraMount(0.0, 0.0, 1.0, 0.0, -1.0, 0.0))
CONFIG = GroundCameraConfig(
    patch_depth_m=1.0, patch_near_width_m=0.6, patch_far_width_m=0.6, max_range_m=12.0
)


@pytest.mark.recordings("places/rtabmap")
def test_a_corridors_floor_ends_at_its_skirting_boards(recordings: Path) -> None:
    picture = cv2.imread(str(recordings / "places" / "rtabmap" / "1.jpg"))
    view = GroundCamera(CAMERA, CONFIG).step(np.asarray(picture, np.uint8), 0)
    assert view.trusted
    points = CAMERA.project_ground(view.scan.points_base())
    # The board of the left wall runs from the lower edge up to where the corridor turns.
    left = points[(points[:, 0] > 110.0) & (points[:, 0] < 200.0) & (points[:, 1] < 380.0)]
    line = np.interp(left[:, 0], [115.0, 205.0], [375.0, 265.0])
    assert len(left) > 8
    assert np.median(np.abs(left[:, 1] - line)) < 12.0


@pytest.mark.recordings("places/rtabmap")
def test_no_picture_of_a_recording_breaks_anything(recordings: Path) -> None:
    camera = GroundCamera(CAMERA, CONFIG)
    files = sorted((recordings / "places" / "rtabmap").glob("*.jpg"))
    assert len(files) > 50
    for k, path in enumerate(files):
        view = camera.step(np.asarray(cv2.imread(str(path)), np.uint8), k)
        assert view.trusted == (view.why == "")
        ranges = view.scan.ranges_m
        assert not np.any(ranges[np.isfinite(ranges)] > CONFIG.max_range_m)
