"""A camera that looks at the floor: its lens, its mount, and the source of its pictures.

Plain numbers without numpy, since the robot's file holds them as the table `[camera]` and every
process reads that. `camera_geometry.py` has their effect on points and pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from robotctl.errors import InvalidValue

MarkerFamily: TypeAlias = Literal[
    "4x4_50", "5x5_100", "6x6_250", "apriltag_16h5", "apriltag_25h9", "apriltag_36h11"
]

MAX_SIDE_PX = 10_000
SIMULATED = "sim"
"""Source of pictures of the simulated camera."""


@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """Size of the picture and the lens: the matrix K and the distortion of Brown (1966).

    A point at x, y of the plane z = 1 of the camera's frame, r^2 = x^2 + y^2, is seen at

        x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
        y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
        u = fx x' + cx,  v = fy y' + cy

    with the centre of the upper left pixel at u = v = 0: the conventions of OpenCV.

    Parameters
    ----------
    width_px, height_px
        Size of the picture, 1 to 10000 [px].
    fx_px, fy_px
        Focal lengths, > 0 [px].
    cx_px, cy_px
        Principal point, the image of the optical axis [px].
    distortion
        (k1, k2, p1, p2, k3).

    Raises
    ------
    ValueError
        If a number is not finite or not in its range.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for key in ("width_px", "height_px"):
            if not 1 <= getattr(self, key) <= MAX_SIDE_PX:
                raise InvalidValue(
                    key, f"must be 1 to {MAX_SIDE_PX}, not {getattr(self, key)}", getattr(self, key)
                )
        _check_finite(self, ("fx_px", "fy_px", "cx_px", "cy_px"))
        for key in ("fx_px", "fy_px"):
            if getattr(self, key) <= 0.0:
                raise InvalidValue(
                    key, f"must be > 0, not {getattr(self, key)}", getattr(self, key)
                )
        if len(self.distortion) != 5 or not all(math.isfinite(k) for k in self.distortion):
            raise InvalidValue(
                "distortion",
                f"must be five finite numbers: k1, k2, p1, p2, k3, found {self.distortion}",
                self.distortion,
            )


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Position and orientation of the camera in `base`.

    With all angles 0 it looks forward along x of `base`, its picture upright. It is turned by
    `yaw_deg` about z, then by `pitch_deg` about its own y, then by `roll_deg` about its own
    optical axis.

    Parameters
    ----------
    x_m, y_m
        Optical centre in `base` [m].
    z_m
        Height of the optical centre above the floor, > 0 [m].
    yaw_deg
        Direction of the optical axis in the plane, 0 forward, 90 left [deg].
    pitch_deg
        Downward angle of the optical axis, -90 to 90, 90 straight down [deg].
    roll_deg
        Roll of the camera to its right, seen from behind [deg].

    Raises
    ------
    ValueError
        If a number is not finite or not in its range.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    def __post_init__(self) -> None:
        _check_finite(self, self.__slots__)
        if self.z_m <= 0.0:
            raise InvalidValue("z_m", f"must be above the floor, > 0, not {self.z_m}", self.z_m)
        if not -90.0 <= self.pitch_deg <= 90.0:
            raise InvalidValue(
                "pitch_deg", f"must be -90 to 90 (down), not {self.pitch_deg}", self.pitch_deg
            )


@dataclass(frozen=True, slots=True)
class MarkerConfig:
    """The table `[camera.markers]`: markers that the robot may dock to.

    Parameters
    ----------
    family
        Family of markers: ArUco or AprilTag, as drawn by `robotctl camera pattern`.
    side_m
        Side of the black square, > 0 [m].

    Raises
    ------
    ValueError
        If the side is not in its range.
    """

    side_m: float
    family: MarkerFamily = "4x4_50"

    def __post_init__(self) -> None:
        if not 0.0 < self.side_m < math.inf:
            raise InvalidValue("side_m", f"must be > 0, not {self.side_m}", self.side_m)


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """The table `[camera]` of a robot's file.

    Parameters
    ----------
    intrinsics
        The lens.
    mount
        Position and orientation in `base`.
    source
        Source of the pictures: `sim` for the simulated camera, else an argument of OpenCV's
        VideoCapture: the number of a device, a file or a URL.
    rate_hz
        Pictures a second, 0.1 to 240 [Hz].
    enabled
        Whether the robot uses the camera: a separate process measures in each picture.
    markers
        Markers to look for; None: none.

    Raises
    ------
    ValueError
        If the source is empty or the rate not in its range.
    """

    intrinsics: CameraIntrinsics
    mount: CameraMount
    source: str = SIMULATED
    rate_hz: float = 10.0
    enabled: bool = False
    markers: MarkerConfig | None = None

    def __post_init__(self) -> None:
        if not self.source:
            raise InvalidValue(
                "source",
                f"must not be empty: sim, a device number, a file or a URL, found {self.source!r}",
                self.source,
            )
        if not 0.1 <= self.rate_hz <= 240.0:
            raise InvalidValue("rate_hz", f"must be 0.1 to 240, not {self.rate_hz}", self.rate_hz)


def _check_finite(value: object, keys: Iterable[str]) -> None:
    """Raise ValueError if one of the numbers is not finite."""
    for key in keys:
        if not math.isfinite(getattr(value, key)):
            raise InvalidValue(key, f"must be finite, found {value}", value)
