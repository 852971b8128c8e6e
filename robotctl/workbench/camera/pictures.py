"""Reading and writing of pictures."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.app.supervision.running_robot import running
from robotctl.drivers.camera.simulated_camera import SimulatedCamera
from robotctl.errors import ConfigError, LinkError
from robotctl.maps.image_file import orientation, read_image
from robotctl.messages.ports import Clock
from robotctl.model.sensors.camera import CameraIntrinsics
from robotctl.runtime.clock import RealClock

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp", ".tif", ".tiff")
_AFTER_IHDR = 33
"""Start of the second chunk of a PNG: 8 bytes of signature, 25 of the first chunk."""


LIVE = "live:"
"""`live:NAME` is what the camera of the running robot NAME sees now."""
_PATIENCE_NS = 5_000_000_000
_LOOK_NS = 20_000_000


def read_picture(path: Path) -> NDArray[np.uint8]:
    """Read a picture.

    Parameters
    ----------
    path
        The file, or `live:NAME`.

    Returns
    -------
    ndarray
        (height, width, 3), blue, green, red, in the sensor's rows: a tag that asks for the picture
        to be turned is not followed, and alpha not looked at.

    Raises
    ------
    ConfigError
        If the file is no picture, damaged or cut short.
    OSError
        If it cannot be read.
    LinkError
        If no such robot runs, or it does not look.
    """
    if str(path).startswith(LIVE):
        return live_picture(str(path).removeprefix(LIVE), RealClock())
    pixels = read_image(path)
    bytes_ = (pixels >> 8 if pixels.dtype == np.uint16 else pixels).astype(np.uint8)
    if bytes_.ndim == 2 or bytes_.shape[2] == 2:
        return np.repeat(np.atleast_3d(bytes_)[..., :1], 3, axis=2)
    return np.ascontiguousarray(bytes_[..., 2::-1])


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
        wanted = intrinsics.height_px, intrinsics.width_px
        raise ConfigError(
            f"{path}: {width} x {height} pixels, but the lens is for "
            f"{intrinsics.width_px} x {intrinsics.height_px}; take pictures of that size: a "
            f"cropped or scaled one has another lens{turned_hint((height, width), wanted)}"
        )


def turned_hint(one: tuple[int, ...], other: tuple[int, ...]) -> str:
    """Return a hint if one of two sizes (height, width) is the other rotated, otherwise ""."""
    if one != other[::-1]:
        return ""
    return (
        "; one has been rotated: give pictures as the camera saved them; orientation tags are "
        "ignored"
    )


def tagged_to_turn(paths: Sequence[Path]) -> list[Path]:
    """Return the files, of pictures that were read, which viewers turn by their EXIF orientation.

    Raises
    ------
    OSError
        If one cannot be read.
    """
    return [path for path in paths if not str(path).startswith(LIVE) and orientation(path) != 1]


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
        f"{LIVE}{instance}: no picture within {_PATIENCE_NS / 1e9:g} s; is its camera on? Set "
        "camera.enabled = true, in simulation use --camera"
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
    """Write a grey picture, (height, width), as PNG with its print size.

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


def pictures_of(names: Sequence[str], option: str = "--lens ") -> tuple[Path, ...]:
    """Return picture files: all of a folder, those matching a pattern, otherwise the file itself.

    `option` is what the user wrote before the name, for messages.

    Raises
    ------
    ConfigError
        If a name fits nothing.
    """
    files: list[Path] = []
    for name in names:
        path = Path(name)
        if path.is_dir():
            found = [each for each in path.iterdir() if each.suffix.lower() in SUFFIXES]
        elif "*" in path.name or "?" in path.name:
            found = list(path.parent.glob(path.name))
        else:
            found = [path]
        if not found:
            raise ConfigError(f"{option}{name}: no pictures found")
        files += sorted(found)
    return tuple(dict.fromkeys(files))
