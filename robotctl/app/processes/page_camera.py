"""Pictures of the camera for the page: small, few, and with what the robot makes of them."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robotctl.drivers.camera.simulated_camera import SimulatedCamera
from robotctl.messages.estimation import CameraView
from robotctl.model.sensors.camera import CameraConfig
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.web.wire import CameraPicture

WIDEST_PX: Final = 640
_QUALITY: Final = 70
_OLD_NS: Final = 1_000_000_000
"""Age of a view by which a picture shows nothing of its scene any more [ns]."""


class PageCamera:
    """Receives pictures only while they are asked for.

    Parameters
    ----------
    address
        `ipc://PATH` of the camera's pictures.
    camera
        Lens and mount.
    """

    def __init__(self, address: str, camera: CameraConfig) -> None:
        self._address = address
        self._geometry = CameraGeometry.of(camera)
        self._source: SimulatedCamera | None = None
        self._decode = msgspec.msgpack.Decoder(CameraView).decode

    def picture(self, view: bytes | None) -> CameraPicture | None:
        """Return the newest picture with the camera's newest published view; None: no new one."""
        if self._source is None:
            self._source = SimulatedCamera(self._address)
        frame = self._source.read()
        if frame is None:
            return None
        height, width = frame.image.shape[:2]
        scale = min(1.0, WIDEST_PX / max(width, height))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        picture = CameraPicture(frame.stamp_ns, *size, _jpeg(frame.image, size))
        seen = None if view is None else self._decode(view)
        if seen is None or frame.stamp_ns - seen.stamp_ns > _OLD_NS:
            return picture
        return msgspec.structs.replace(picture, **self._overlays(seen, scale))

    def close(self) -> None:
        """Receive no more pictures until the next is asked for."""
        if self._source is not None:
            self._source.close()
            self._source = None

    def _overlays(self, view: CameraView, scale: float) -> dict[str, object]:
        """Return what a view says, as fields of a picture that is so many times as large."""
        angles, ranges = np.array(view.angles_rad), np.array(view.ranges_m)
        far = np.where(np.isinf(ranges), view.max_range_m, np.nan)
        ends = np.where(np.isfinite(ranges), ranges, np.nan)
        return {
            "boundary": self._pixels(view, angles, ends, scale),
            "floor": self._pixels(view, angles, far, scale),
            "things": tuple(self._things(view, scale)),
            "trouble": view.trouble,
        }

    def _pixels(
        self,
        view: CameraView,
        angles_rad: NDArray[np.float64],
        ranges_m: NDArray[np.float64],
        scale: float,
    ) -> tuple[tuple[float, float] | None, ...]:
        """Return the pixels of points of the floor (n,), from left to right; None: not in sight."""
        away = np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=1)
        ground = (view.x_m, view.y_m) + ranges_m[:, np.newaxis] * away
        order = np.argsort(-angles_rad)
        return tuple(_pixel(each, scale) for each in self._project(ground)[order])

    def _things(self, view: CameraView, scale: float) -> list[tuple[float, float, float]]:
        """Return the pixels of obstacles' feet, and how wide they are there [px]."""
        things = []
        for each in view.obstacles:
            turn = math.atan2(each.y_m - view.y_m, each.x_m - view.x_m)
            aside = 0.5 * each.width_m * np.array([-math.sin(turn), math.cos(turn)])
            foot = np.array([each.x_m, each.y_m])
            at, left, right = self._project(np.array([foot, foot + aside, foot - aside]))
            pixel, width = _pixel(at, scale), float(np.hypot(*(left - right))) * scale
            if pixel is not None and math.isfinite(width):
                things.append((*pixel, width))
        return things

    def _project(self, ground: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(invalid="ignore"):
            return self._geometry.project_ground(ground)


def _jpeg(image_bgr: NDArray[np.uint8], size: tuple[int, int]) -> bytes:
    """Return a picture in a size, width and height [px]. Pillow takes half of OpenCV's memory."""
    height, width = image_bgr.shape[:2]
    picture = Image.frombytes("RGB", (width, height), image_bgr.tobytes(), "raw", "BGR")
    if size != (width, height):
        picture = picture.resize(size, Image.Resampling.BOX)
    packed = io.BytesIO()
    picture.save(packed, "JPEG", quality=_QUALITY)
    return packed.getvalue()


def _pixel(place: Sequence[float], scale: float) -> tuple[float, float] | None:
    """Return a pixel of the small picture; None: there is none."""
    u, v = float(place[0]) * scale, float(place[1]) * scale
    return (round(u, 1), round(v, 1)) if math.isfinite(u) and math.isfinite(v) else None
