"""Pictures for the page: their size, and that what the robot says lies where OpenCV projects it."""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np
import pytest

from robotctl.app.processes import page_camera
from robotctl.config.robot_file import find_file, load_robot
from robotctl.messages.camera_port import CameraFrame
from robotctl.messages.estimation import CameraView, SeenObstacle
from robotctl.model.sensors.camera_lens import camera_matrix

CONFIG = load_robot(find_file("diff_drive")).camera
LENS = CONFIG.intrinsics
VIEW = CameraView(
    1, 0.1, 0.0, 3.0, (0.2, 0.0, -0.2), (1.5, math.inf, math.nan), (0.0,) * 3, (0.3,) * 3,
    (SeenObstacle(1.2, 0.1, (0.0,) * 3, 0.3),), "too dark",
)  # fmt: skip


class Source:
    """Has one picture of a size."""

    size = (LENS.height_px, LENS.width_px)
    closed = 0

    def __init__(self, _address):
        self.frames = [CameraFrame(1, 1, np.full((*self.size, 3), 90, np.uint8))]

    def read(self):
        return self.frames.pop() if self.frames else None

    def close(self):
        Source.closed += 1


@pytest.fixture
def camera(monkeypatch):
    monkeypatch.setattr(page_camera, "SimulatedCamera", Source)
    return page_camera.PageCamera("ipc:///nowhere", CONFIG)


def seen_by_opencv(x_m, y_m):
    """Return the pixel of a point of the floor, by OpenCV's model of a camera."""
    mount = CONFIG.mount
    yaw, pitch, roll = (math.radians(a) for a in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg))
    turn = cv2.Rodrigues(np.array([0.0, 0.0, yaw]))[0]
    turn = turn @ cv2.Rodrigues(np.array([0.0, pitch, 0.0]))[0]
    turn = turn @ cv2.Rodrigues(np.array([roll, 0.0, 0.0]))[0]
    axes = turn @ np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    t = -axes.T @ np.array([mount.x_m, mount.y_m, mount.z_m])
    distortion = np.array(LENS.distortion, np.float64)
    points, _ = cv2.projectPoints(
        np.array([[x_m, y_m, 0.0]]), cv2.Rodrigues(axes.T)[0], t, camera_matrix(LENS), distortion
    )
    return points.ravel()


def test_ends_of_the_floor_and_things_lie_where_opencv_projects_them(camera):
    picture = camera.picture(msgspec.msgpack.encode(VIEW))
    scale = picture.width / LENS.width_px
    left = seen_by_opencv(0.1 + 1.5 * math.cos(0.2), 1.5 * math.sin(0.2)) * scale
    assert picture.boundary[0] == pytest.approx(left, abs=0.1)
    assert picture.boundary[1:] == (None, None)
    assert picture.floor[1] == pytest.approx(seen_by_opencv(3.1, 0.0) * scale, abs=0.1)
    assert (picture.floor[0], picture.floor[2]) == (None, None)
    ((u, v, width),) = picture.things
    assert (u, v) == pytest.approx(seen_by_opencv(1.2, 0.1) * scale, abs=0.1)
    assert 20 < width < 400
    assert picture.trouble == "too dark"


def test_a_large_picture_is_made_small_and_read_back(camera, monkeypatch):
    monkeypatch.setattr(Source, "size", (1080, 1920))
    picture = camera.picture(None)
    assert (picture.width, picture.height) == (640, 360)
    image = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (360, 640, 3)
    assert abs(int(image[100, 100, 0]) - 90) < 4
    assert picture.boundary == ()


def test_there_is_one_picture_of_each_and_closing_listens_no_more(camera):
    assert camera.picture(None) is not None
    assert camera.picture(None) is None
    before = Source.closed
    camera.close()
    assert Source.closed == before + 1
