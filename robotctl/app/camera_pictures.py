"""Where pictures come from and go to."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.app.running_robot import running
from robotctl.drivers.simulated_camera import SimulatedCamera
from robotctl.errors import ConfigError, LinkError
from robotctl.model.camera import CameraIntrinsics
from robotctl.runtime.clock import RealClock
from robotctl.runtime.ports import Clock

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff")
_AFTER_IHDR = 33
"""Where the second chunk of a PNG begins: 8 bytes of signature, 25 of the first chunk."""


LIVE = "live:"
"""`live:NAME` is what the camera of the running robot NAME sees now."""
_PATIENCE_NS = 5_000_000_000
_LOOK_NS = 20_000_000


def read_picture(path: Path) -> NDArray[np.uint8]:
    """Read a picture.

    Parameters
    ----------
    path
        The file, in any format that OpenCV reads, or `live:NAME`.

    Returns
    -------
    ndarray
        (height, width, 3), blue, green, red.

    Raises
    ------
    ConfigError
        If the file is no picture.
    OSError
        If it cannot be read.
    LinkError
        If no such robot runs, or it does not look.
    """
    if str(path).startswith(LIVE):
        return live_picture(str(path).removeprefix(LIVE), RealClock())
    data = np.frombuffer(path.read_bytes(), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if picture is None:
        raise ConfigError(f"{path}: not a picture that can be read ({', '.join(SUFFIXES)})")
    return picture.astype(np.uint8, copy=False)


def read_picture_of(path: Path, intrinsics: CameraIntrinsics) -> NDArray[np.uint8]:
    """Read a picture that the camera with these intrinsics took, as `read_picture`.

    Raises
    ------
    ConfigError
        As there, and as `check_size`.
    """
    picture = read_picture(path)
    check_size(picture, path, intrinsics)
    return picture


def check_size(picture: NDArray[np.uint8], path: Path, intrinsics: CameraIntrinsics) -> None:
    """Refuse a picture of another size than the lens is for.

    Raises
    ------
    ConfigError
        If it is: cut or scaled, it has another lens.
    """
    height, width = picture.shape[:2]
    if (width, height) != (intrinsics.width_px, intrinsics.height_px):
        raise ConfigError(
            f"{path}: {width} x {height} pixels, but the lens is for "
            f"{intrinsics.width_px} x {intrinsics.height_px}; take pictures of that size: one "
            "that is cut or scaled has another lens"
        )


def live_picture(instance: str, clock: Clock) -> NDArray[np.uint8]:
    """Return the next picture of a running robot's camera, simulated or real, as `read_picture`.

    Raises
    ------
    LinkError
        If no such robot runs, or it does not look.
    """
    camera = SimulatedCamera(running(instance).camera_frames)
    try:
        began_ns = clock.now_ns()
        while clock.now_ns() - began_ns < _PATIENCE_NS:
            frame = camera.read()
            if frame is not None:
                return frame.image
            clock.sleep_until(clock.now_ns() + _LOOK_NS)
    finally:
        camera.close()
    raise LinkError(
        f"{LIVE}{instance}: no picture within {_PATIENCE_NS / 1e9:g} s; does the robot look? It "
        "does with camera.enabled = true, a simulated one with --camera"
    )


def check_suffix(path: Path) -> None:
    """Refuse to write a picture into a file whose suffix names no format, before the work is done.

    Raises
    ------
    ConfigError
        If the suffix is not one of `SUFFIXES`.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"{path}: the suffix must be one of {', '.join(SUFFIXES)}")


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """Write a picture, (height, width, 3) blue, green, red or (height, width) grey.

    Raises
    ------
    ConfigError
        If the suffix is not one of `SUFFIXES`.
    OSError
        If it cannot be written.
    """
    check_suffix(path)
    _, data = cv2.imencode(path.suffix.lower(), picture)
    path.write_bytes(data.tobytes())


def write_print(path: Path, picture: NDArray[np.uint8], px_per_mm: int) -> None:
    """Write a grey picture, (height, width), as PNG that says how large it is in print.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    _, data = cv2.imencode(".png", picture)
    png = data.tobytes()
    # Chunk pHYs of the PNG specification (11.3.4.3), behind IHDR: pixels per metre.
    body = b"pHYs" + struct.pack(">IIB", 1000 * px_per_mm, 1000 * px_per_mm, 1)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    path.write_bytes(png[:_AFTER_IHDR] + chunk + png[_AFTER_IHDR:])
