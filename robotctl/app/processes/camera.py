"""The camera process: pictures in, free floor and obstacles out.

A picture is never kept: of those that came while one was looked at only the newest counts.
"""

from __future__ import annotations

import sys
from contextlib import closing

from robotctl.app.localisation.slam_sensor import recognises_places
from robotctl.app.processes.camera_source import open_source
from robotctl.app.processes.entry import enter
from robotctl.app.processes.floor_pipeline import GroundWatch
from robotctl.app.processes.sensor_sockets import SensorSockets
from robotctl.app.supervision.signals import StopFlag
from robotctl.config.options import StackOptions
from robotctl.config.robot_file import RobotConfig
from robotctl.drivers.camera.simulated_camera import picture_message
from robotctl.errors import ConfigError
from robotctl.messages.control import Notice, Severity
from robotctl.model.sensors.camera import SIMULATED
from robotctl.runtime.ipc.topics import Endpoints, Publisher, endpoint_directory

_LOOK_NS = 5_000_000
_SILENT_NS = 2_000_000_000
_TELL_NS = 5_000_000_000
_SILENT = "no pictures arrive"


class CameraNotices:
    """Decides which camera notices to send, and how often."""

    def __init__(self) -> None:
        self._told: str | None = None  # the trouble, empty for none; None: nothing yet
        self._told_ns = 0

    def step(self, trouble: str, now_ns: int) -> Notice | None:
        """Return the notice on the present trouble, empty for none; None: nothing new, or later.

        A borderline floor would fill a slow link with a verdict per picture.
        """
        if trouble == self._told or (self._told is not None and now_ns - self._told_ns < _TELL_NS):
            return None
        self._told, self._told_ns = trouble, now_ns
        if trouble:
            text = f"the camera cannot judge the floor: {trouble}"
            return Notice(now_ns, Severity.WARNING, text)
        return Notice(now_ns, Severity.INFORMATION, "the camera sees the floor")


def run(config: RobotConfig, options: StackOptions) -> None:
    """Look until SIGTERM or SIGINT.

    Raises
    ------
    ConfigError
        If the robot has no camera, or it sees too little of the floor.
    LinkError
        If the camera cannot be opened, or gives no more pictures.
    """
    stopped = StopFlag()
    clock = options.open_clock()
    if config.camera is None:
        raise ConfigError(
            "camera: missing; a robot whose camera is enabled needs the table [camera]"
        )
    endpoints = Endpoints(endpoint_directory(options.instance))
    camera = open_source(config.camera, endpoints.camera_frames)
    with closing(camera), SensorSockets(endpoints, endpoints.camera) as sockets:
        publisher = sockets.publisher
        onlookers: Publisher | None = None
        if config.camera.source != SIMULATED:
            onlookers = Publisher(sockets.context, endpoints.camera_frames, queue=1)
        with_features = recognises_places(config)
        watch = GroundWatch(config.camera, config.ground_camera, with_features=with_features)
        notices = CameraNotices()
        trouble: str | None = None  # before the first picture
        seen_ns = clock.now_ns()
        while not stopped():
            sockets.beat()
            for state in sockets.states():
                watch.attend(state)
            frame = camera.read()
            if frame is not None:
                view = watch.look(frame.image, frame.stamp_ns)
                publisher.send(view)
                if onlookers is not None:
                    onlookers.send_bytes(picture_message(frame))
                trouble, seen_ns = view.trouble, clock.now_ns()
            else:
                clock.sleep_until(clock.now_ns() + _LOOK_NS)
                if clock.now_ns() - seen_ns > _SILENT_NS:
                    trouble = _SILENT
            notice = None if trouble is None else notices.step(trouble, clock.now_ns())
            if notice is not None:
                publisher.send(notice)
                publisher.greet(notice)


if __name__ == "__main__":
    sys.exit(enter("camera", run, device_may_come=True))
