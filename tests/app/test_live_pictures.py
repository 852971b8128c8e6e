"""Pictures of a running robot."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
import zmq

from robotctl.app import camera_pictures
from robotctl.app.camera_pictures import read_picture
from robotctl.drivers.simulated_camera import picture_message
from robotctl.errors import LinkError
from robotctl.runtime.camera_port import CameraFrame
from robotctl.runtime.topics import Endpoints, Publisher, endpoint_directory


@pytest.fixture
def robot(tmp_path, monkeypatch):
    """A robot `rover` that runs; gives what publishes its pictures."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    context = zmq.Context()
    endpoints = Endpoints(endpoint_directory("rover"))
    states = Publisher(context, endpoints.control_state)
    pictures = Publisher(context, endpoints.camera_frames, queue=1)
    yield pictures
    pictures.close()
    states.close()
    context.destroy(linger=0)


def test_the_picture_of_a_running_robot_is_read_as_a_file_is(robot):
    image = np.random.default_rng(1).integers(0, 255, (4, 6, 3), dtype=np.uint8)
    message = picture_message(CameraFrame(5, 1, image))
    ended = threading.Event()

    def publish():
        while not ended.wait(0.01):
            robot.send_bytes(message)

    publisher = threading.Thread(target=publish)
    publisher.start()
    try:
        found = read_picture(Path("live:rover"))
    finally:
        ended.set()
        publisher.join()
    np.testing.assert_array_equal(found, image)


@pytest.mark.usefixtures("robot")
def test_a_robot_that_does_not_look_or_does_not_run_is_said(monkeypatch):
    monkeypatch.setattr(camera_pictures, "_PATIENCE_S", 0.05)
    with pytest.raises(LinkError, match=r"live:rover: no picture within 0\.05 s; .*--camera"):
        read_picture(Path("live:rover"))
    with pytest.raises(LinkError, match='rovr: no robot of that name runs; did you mean "rover"'):
        read_picture(Path("live:rovr"))
