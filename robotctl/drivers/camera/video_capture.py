"""Real cameras through OpenCV: devices, URLs, videos and sequences of images.

The only module of `drivers` that may load OpenCV. It belongs into a process of its own, never into
the control process.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.errors import LinkError
from robotctl.messages.camera_port import CameraFrame, CameraPort
from robotctl.messages.ports import Clock

Size: TypeAlias = tuple[int, int]
"""Width and height [px]."""

_OLDEST_NS = 1_000_000_000
"""Age beyond which, or if in the future, a driver's own stamp is of another clock."""
_END_S = 2.0
"""Maximum wait for the thread of a camera to end [s]: a driver may hang."""


def open_camera(source: str, size: Size, rate_hz: float, clock: Clock) -> CameraPort:
    """Open a real camera.

    Parameters
    ----------
    source
        Number or path of a device, URL, path of a video, or pattern of images such as
        `left%02d.jpg`.
    size
        Width and height that the pictures must have [px]: those of the calibration.
    rate_hz
        Requested from a device; pace of a sequence of images, which has no other [Hz].
    clock
        Stamps pictures, and paces files.

    Raises
    ------
    LinkError
        If it cannot be opened or gives other pictures; says what to do.
    """
    if _is_device(source) or "://" in source:
        return LiveCamera(source, size, rate_hz, clock)
    if "%" not in source and not Path(source).is_file():
        raise LinkError(
            f"camera: {source}: no such file; allowed are the number or path of a device, a URL, "
            "the path of a video, or a pattern of images such as left%02d.jpg"
        )
    return VideoFile(source, size, rate_hz, clock)


class VideoFile:
    """A video or a sequence of images, played as if from a camera, at its own rate.

    After its last picture nothing comes. Parameters and errors as `open_camera`.
    """

    def __init__(self, source: str, size: Size, rate_hz: float, clock: Clock) -> None:
        self._capture = _opened(source)
        self._clock = clock
        told_hz = float(self._capture.get(cv2.CAP_PROP_FPS))
        self._rate_hz = told_hz if told_hz > 0.0 and "%" not in source else rate_hz
        self._begin_ns = clock.now_ns()
        self._next = 0
        count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        try:
            if count == 0:
                raise LinkError(f"camera: {source}: no pictures in it")
            _check_size(source, _told_size(self._capture), size)
        except LinkError:
            self._capture.release()
            raise

    def read(self) -> CameraFrame | None:
        """Return the picture whose time has come, if it was not yet read; None if none."""
        due = int((self._clock.now_ns() - self._begin_ns) * self._rate_hz / 1e9)
        newest = None
        while self._next <= due:
            found, image = self._capture.read()
            if not found:
                break
            newest = image
            self._next += 1
        if newest is None:
            return None
        number = self._next - 1
        stamp_ns = self._begin_ns + round(number / self._rate_hz * 1e9)
        return CameraFrame(stamp_ns, number, _pixels(newest))

    def close(self) -> None:
        """Close the file."""
        self._capture.release()


class LiveCamera:
    """A device or a stream. A thread takes every picture, since drivers queue the old ones.

    Parameters and errors as `open_camera`.
    """

    def __init__(self, source: str, size: Size, rate_hz: float, clock: Clock) -> None:
        self._source = source
        self._clock = clock
        self._capture = _opened(source)
        if _is_device(source):
            width, height = size
            for key, value in (
                (cv2.CAP_PROP_FRAME_WIDTH, width),
                (cv2.CAP_PROP_FRAME_HEIGHT, height),
                (cv2.CAP_PROP_FPS, rate_hz),
            ):
                self._capture.set(key, value)
        try:
            _check_size(source, _told_size(self._capture), size)
        except LinkError:
            self._capture.release()
            raise
        self._lock = threading.Lock()
        self._newest: CameraFrame | None = None
        self._lost = False
        self._why = ""
        self._closing = False
        self._thread = threading.Thread(target=self._take, name=f"camera {source}", daemon=True)
        self._thread.start()

    def read(self) -> CameraFrame | None:
        """Return the newest picture not yet read; None if there is none.

        Raises
        ------
        LinkError
            If the camera gives no more pictures.
        """
        with self._lock:
            frame, self._newest = self._newest, None
        if frame is None and self._lost:
            raise LinkError(
                f"camera {self._source}: gives no more pictures{self._why}; check that it is still "
                "plugged in or its stream is up, then restart"
            )
        return frame

    def close(self) -> None:
        """Release the camera; a hanging one is left until the process ends."""
        self._closing = True
        self._thread.join(_END_S)

    def _take(self) -> None:
        """Take pictures until the end, whatever it is; the capture belongs to this thread."""
        try:
            self._take_pictures()
        except (cv2.error, ValueError) as error:
            self._why = f" ({str(error).strip()})"
        finally:
            self._lost = not self._closing
            self._capture.release()

    def _take_pictures(self) -> None:
        number = 0
        while not self._closing:
            if not self._capture.grab():
                return
            arrived_ns = self._clock.now_ns()
            stamp_ns = _exposed_ns(self._capture.get(cv2.CAP_PROP_POS_MSEC), arrived_ns)
            found, image = self._capture.retrieve()
            if found:
                frame = CameraFrame(stamp_ns, number, _pixels(image))
                with self._lock:
                    self._newest = frame
            number += 1


def _opened(source: str) -> cv2.VideoCapture:
    """Open a source; OpenCV's own warnings are silenced, because our error is more precise."""
    loud = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        capture = cv2.VideoCapture(int(source) if source.isdecimal() else source)
    finally:
        cv2.utils.logging.setLogLevel(loud)
    if capture.isOpened():
        if not _is_device(source):
            # A video that is to be shown turned is taken as the sensor has it, as calibrated.
            capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return capture
    if not _is_device(source):
        raise LinkError(f"camera: {source}: cannot be opened as a video or stream")
    device = f"/dev/video{source}" if source.isdecimal() else source
    there = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*"))) or "none"
    raise LinkError(
        f"camera: {device}: cannot be opened: check that it is plugged in, not in use "
        f"(`fuser {device}`) and open to this user (group video); devices: {there}"
    )


def _is_device(source: str) -> bool:
    """Whether a source is the number or the path of a device."""
    return source.isdecimal() or Path(source).is_char_device()


def _told_size(capture: cv2.VideoCapture) -> Size:
    """Return the size of the pictures to come."""
    return (
        int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
        int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
    )


def _check_size(source: str, found: Size, wanted: Size) -> None:
    """Raise LinkError where the pictures are not those that were calibrated."""
    if found != wanted:
        raise LinkError(
            f"camera {source}: gives {found[0]} x {found[1]} px, camera.intrinsics has "
            f"{wanted[0]} x {wanted[1]}; calibrate for that size, or set one that the camera "
            "supports"
        )


def _exposed_ns(told_ms: float, arrived_ns: int) -> int:
    """Return the driver's stamp if it is of our clock (as with V4L2), otherwise the arrival."""
    told_ns = round(told_ms * 1e6)
    return told_ns if 0 <= arrived_ns - told_ns <= _OLDEST_NS else arrived_ns


def _pixels(image: cv2.typing.MatLike) -> NDArray[np.uint8]:
    """Return a picture of OpenCV as an array of bytes."""
    return np.ascontiguousarray(image, dtype=np.uint8)
