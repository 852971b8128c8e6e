"""The camera that a robot's file names, simulated or real."""

from __future__ import annotations

from robotctl.drivers.camera.simulated_camera import SimulatedCamera
from robotctl.messages.camera_port import CameraPort
from robotctl.model.sensors.camera import SIMULATED, CameraConfig
from robotctl.runtime.clock import RealClock


def open_source(camera: CameraConfig, simulated: str) -> CameraPort:
    """Open a camera.

    Parameters
    ----------
    camera
        Its configuration.
    simulated
        `ipc://PATH` of the simulated camera's pictures.

    Raises
    ------
    LinkError
        If it cannot be opened.
    """
    if camera.source == SIMULATED:
        return SimulatedCamera(simulated)
    # OpenCV.
    from robotctl.drivers.camera.video_capture import open_camera  # noqa: PLC0415

    lens = camera.intrinsics
    size = (lens.width_px, lens.height_px)
    return open_camera(camera.source, size, camera.rate_hz, RealClock())
