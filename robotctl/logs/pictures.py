"""Pictures of the camera beside the logs: `pictures-0001/STAMP.jpg`, by the time of all logs."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from io import BytesIO
from typing import Final

from PIL import Image

from robotctl.logs.formats.image_folder import image_name
from robotctl.messages.camera_port import CameraFrame
from robotctl.runtime.storage.log_folder import LogFolder

_QUALITY: Final = 85
_EARLY: Final = 10
"""Part of the period (1/n) by which a picture may come early, since stamps jitter."""


class PictureLog:
    """Stores pictures at an interval, as JPEG.

    The folder has the number of the run's first log of states. All pictures together have the size
    limit of the logs; the oldest are removed first.

    Parameters
    ----------
    folder
        Folder of the logs.
    every_s
        Time between pictures, > 0 [s].
    epoch_ns
        Added to a picture's time to get that of the logs [ns].
    """

    def __init__(self, folder: LogFolder, every_s: float, epoch_ns: int) -> None:
        self._most_bytes = folder.total_bytes
        self._directory = folder.pictures()
        self._every_ns = round(every_s * 1e9)
        self._epoch_ns = epoch_ns
        self._due_ns = 0
        known = folder.directory.glob("pictures-*/*.jpg")
        self._kept = deque((path, path.stat().st_size) for path in sorted(known))
        self._bytes = sum(size for _, size in self._kept)

    def step(self, frame: CameraFrame | None) -> None:
        """Write the newest picture if one is due; raises OSError if the disk refuses."""
        if frame is None or frame.stamp_ns + self._every_ns // _EARLY < self._due_ns:
            return
        self._due_ns = max(self._due_ns, frame.stamp_ns) + self._every_ns
        picture = BytesIO()
        rgb = Image.fromarray(frame.image[:, :, ::-1])
        rgb.save(picture, "JPEG", quality=_QUALITY)
        self._directory.mkdir(exist_ok=True)
        path = self._directory / f"{image_name(frame.stamp_ns + self._epoch_ns)}.jpg"
        try:
            size = path.write_bytes(picture.getbuffer())
        except OSError:
            path.unlink(missing_ok=True)  # an incomplete picture
            with suppress(OSError):  # it has other pictures
                self._directory.rmdir()
            raise
        self._kept.append((path, size))
        self._bytes += size
        while self._bytes > self._most_bytes:
            self._remove_oldest()

    def _remove_oldest(self) -> None:
        """Make room; raises OSError if the disk refuses this, too."""
        path, size = self._kept.popleft()
        self._bytes -= size
        path.unlink(missing_ok=True)
        if self._kept[0][0].parent != path.parent:
            with suppress(OSError):  # other files are there
                path.parent.rmdir()
