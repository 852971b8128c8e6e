"""The camera of a lockstep run: each picture is drawn and looked at in virtual time."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from firmware_sim.errors import SimulationError
from robotctl.app.simulation.simulator_files import SimulatorError
from robotctl.config.robot_file import RobotConfig
from robotctl.messages.camera_port import CameraFrame
from robotctl.messages.control import ControlState
from robotctl.messages.estimation import CameraView

if TYPE_CHECKING:
    from firmware_sim.simulation import Simulation
    from robotctl.app.processes.floor_pipeline import GroundWatch


class LockstepCamera:
    """Takes pictures at the camera's rate; a view is available after the camera's latency.

    Parameters
    ----------
    watch
        Makes views of pictures.
    rate_hz
        Of the camera [Hz].

    Attributes
    ----------
    frame
        The newest picture; None before the first.
    """

    def __init__(self, watch: GroundWatch, rate_hz: float) -> None:
        self.frame: CameraFrame | None = None
        self._watch = watch
        self._period_ns = round(1e9 / rate_hz)
        self._due_ns = 0
        self._waiting: deque[CameraView] = deque()

    @staticmethod
    def load(config: RobotConfig) -> LockstepCamera | None:
        """Return the camera of a robot that looks, compiled; else None, with nothing loaded."""
        if config.camera is None or not config.camera.enabled:
            return None
        # OpenCV and numba.
        from robotctl.app.localisation.slam_sensor import recognises_places  # noqa: PLC0415
        from robotctl.app.processes.floor_pipeline import GroundWatch  # noqa: PLC0415

        with_features = recognises_places(config)
        watch = GroundWatch(config.camera, config.ground_camera, with_features=with_features)
        return LockstepCamera(watch, config.camera.rate_hz)

    def step(self, simulation: Simulation, control: ControlState) -> list[CameraView]:
        """Look if it is time; return the views that have arrived.

        Raises
        ------
        SimulatorError
            If the simulated camera cannot be: told at the first look, which makes it.
        """
        now_ns = control.stamp_ns
        self._watch.attend(control)
        latency_ns = simulation.config.simulation.camera.latency_ms * 1_000_000
        if now_ns >= self._due_ns:
            self._due_ns = max(self._due_ns + self._period_ns, now_ns)
            try:
                picture = simulation.camera_frame()
            except SimulationError as error:
                raise SimulatorError(str(error)) from error
            if picture is not None:
                shape = (picture.height, picture.width, 3)
                image = np.frombuffer(picture.pixels, np.uint8).reshape(shape)
                self.frame = CameraFrame(picture.stamp_ns, picture.sequence, image)
                self._waiting.append(self._watch.look(image, picture.stamp_ns))
        arrived = []
        while self._waiting and self._waiting[0].stamp_ns + latency_ns <= now_ns:
            arrived.append(self._waiting.popleft())
        return arrived
