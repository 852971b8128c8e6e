"""Pictures of a running robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import zmq

from robotctl.drivers.camera.simulated_camera import picture_message
from robotctl.errors import LinkError
from robotctl.messages.camera_port import CameraFrame
from robotctl.runtime.clock import VirtualClock
from robotctl.runtime.ipc.topics import Endpoints, Publisher, endpoint_directory
from robotctl.workbench.camera.pictures import live_picture, read_picture


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


def test_the_next_picture_of_a_running_robot_is_waited_for(robot):
    image = np.random.default_rng(1).integers(0, 255, (4, 6, 3), dtype=np.uint8)
    message = picture_message(CameraFrame(5, 1, image))

    class Publishing:
        """Time stands still; the robot looks each time that somebody waits."""

        def now_ns(self):
            return 0

        def sleep_until(self, _deadline_ns):
            robot.send_bytes(message)

    np.testing.assert_array_equal(live_picture("rover", Publishing()), image)


@pytest.mark.usefixtures("robot")
def test_a_robot_that_does_not_look_or_does_not_run_is_said():
    with pytest.raises(LinkError, match=r"live:rover: no picture within 5 s; .*--camera"):
        live_picture("rover", VirtualClock())
    with pytest.raises(LinkError, match='rovr: no robot of that name runs; did you mean "rover"'):
        read_picture(Path("live:rovr"))
