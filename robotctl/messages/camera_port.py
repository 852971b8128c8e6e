"""Port of the camera, which returns the newest picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """One picture.

    Parameters
    ----------
    stamp_ns
        Exposure time, or arrival if the camera does not report it [ns], monotonic.
    sequence
        Number of the picture since the camera was opened; gaps are missed pictures.
    image
        (height, width, 3) uint8, blue, green, red; read-only.

    Raises
    ------
    ValueError
        If the image has another shape or type.
    """

    stamp_ns: int
    sequence: int
    image: NDArray[np.uint8]

    def __post_init__(self) -> None:
        if self.image.ndim != 3 or self.image.shape[2] != 3 or self.image.dtype != np.uint8:
            raise ValueError(
                f"image must be (height, width, 3) uint8, found {self.image.shape} "
                f"{self.image.dtype}"
            )
        self.image.flags.writeable = False


class CameraPort(Protocol):
    """A camera. Only the newest picture is kept, since a robot acts on the present."""

    def read(self) -> CameraFrame | None:
        """Return, without waiting for the camera, the newest picture not yet read; None if none.

        Raises
        ------
        LinkError
            If the camera is lost.
        """

    def close(self) -> None:
        """Release the camera."""
