"""The camera of the robot's file, and how the true one differs from it.

`[camera]` is what robotctl believes; `[simulation.camera]` makes it wrong, noisy and dim.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from firmware_sim.config.quantities import (
    NotNegative,
    Positive,
    Rate,
    Real,
    RelativeError,
    Share,
    closed,
)

Pixels = Annotated[int, Field(strict=True, ge=1, le=10_000)]


@closed
@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Size of the picture, focal lengths, principal point, distortion k1, k2, p1, p2, k3.

    As OpenCV has them: the centre of the upper left pixel is at 0, 0.
    """

    width_px: Pixels
    height_px: Pixels
    fx_px: Positive
    fy_px: Positive
    cx_px: Real
    cy_px: Real
    distortion: tuple[Real, Real, Real, Real, Real] = (0.0, 0.0, 0.0, 0.0, 0.0)


@closed
@dataclass(frozen=True, slots=True)
class CameraMount:
    """Optical centre in base; turned about z, then its own y (down), then its own axis."""

    x_m: Real
    y_m: Real
    z_m: Positive
    yaw_deg: Real = 0.0
    pitch_deg: Annotated[float, Field(strict=True, ge=-90, le=90)] = 0.0
    roll_deg: Real = 0.0


@closed
@dataclass(frozen=True, slots=True)
class CameraSection:
    """The table `[camera]`; `source`, `enabled` and `markers` are robotctl's."""

    intrinsics: Intrinsics
    mount: CameraMount
    source: str = "sim"
    rate_hz: Rate = 10.0
    enabled: bool = False
    markers: dict[str, Any] | None = None


@closed
@dataclass(frozen=True, slots=True)
class CameraParameters:
    """The table `[simulation.camera]`: the true camera against the nominal one, light and noise.

    `*_error` are true minus nominal, `focal_error` relative. A channel of 0 to 255 has Gaussian
    noise of the variance `read_noise`² + `shot_noise` · value. `vignetting` is the loss of light in
    the corners, `exposure` a factor on all light, `ambient` the share of light that has no shadow,
    `blur_px` the standard deviation of the lens's blur. A picture arrives `latency_ms` after its
    exposure.
    """

    x_error_m: Real = 0.0
    y_error_m: Real = 0.0
    z_error_m: Real = 0.0
    yaw_error_deg: Real = 0.0
    pitch_error_deg: Real = 0.0
    roll_error_deg: Real = 0.0
    focal_error: RelativeError = 0.0
    cx_error_px: Real = 0.0
    cy_error_px: Real = 0.0
    read_noise: NotNegative = 1.5
    shot_noise: NotNegative = 0.03
    vignetting: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.25
    exposure: Positive = 1.0
    ambient: Share = 0.45
    blur_px: Annotated[float, Field(strict=True, ge=0, le=0.7)] = 0.5
    latency_ms: Annotated[float, Field(strict=True, ge=0, le=1000)] = 30.0

    def true_intrinsics(self, nominal: Intrinsics) -> Intrinsics:
        """Return the intrinsics of the true camera."""
        return dataclasses.replace(
            nominal,
            fx_px=nominal.fx_px * (1.0 + self.focal_error),
            fy_px=nominal.fy_px * (1.0 + self.focal_error),
            cx_px=nominal.cx_px + self.cx_error_px,
            cy_px=nominal.cy_px + self.cy_error_px,
        )

    def true_mount(self, nominal: CameraMount) -> CameraMount:
        """Return the mount of the true camera.

        Raises
        ------
        ValueError
            If that is below the floor.
        """
        z_m = nominal.z_m + self.z_error_m
        if z_m <= 0.0 or not math.isfinite(z_m):
            raise ValueError(
                f"simulation.camera.z_error_m: puts the camera at {z_m} m, below the floor"
            )
        return CameraMount(
            x_m=nominal.x_m + self.x_error_m,
            y_m=nominal.y_m + self.y_error_m,
            z_m=z_m,
            yaw_deg=nominal.yaw_deg + self.yaw_error_deg,
            pitch_deg=nominal.pitch_deg + self.pitch_error_deg,
            roll_deg=nominal.roll_deg + self.roll_error_deg,
        )
