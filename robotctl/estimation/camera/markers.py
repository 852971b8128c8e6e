"""Square markers on upright things, as docks have them: which one, and where it stands."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.camera.calibration.pattern import MARKERS
from robotctl.messages.estimation import SeenMarker
from robotctl.model.sensors.camera import MarkerConfig
from robotctl.model.sensors.camera_geometry import CameraGeometry
from robotctl.model.sensors.camera_lens import camera_matrix

_UPRIGHT: Final = 0.35
"""Maximum share of a marker's normal that may point up or down."""


class MarkerDetector:
    """Finds markers of one family and size.

    A square that is seen almost from straight ahead fits two poses; of them that of an upright one
    counts (Collins and Bartoli 2014, through OpenCV's solvePnPGeneric).

    Parameters
    ----------
    geometry
        Lens and mount.
    config
        Family and size.
    """

    def __init__(self, geometry: CameraGeometry, config: MarkerConfig) -> None:
        self._geometry = geometry
        self._matrix = camera_matrix(geometry.intrinsics)
        self._distortion = np.array(geometry.intrinsics.distortion)
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        dictionary = cv2.aruco.getPredefinedDictionary(MARKERS[config.family])
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)
        half_m = 0.5 * config.side_m
        # In the order of OpenCV's corners: x to the right, y up, z towards who looks at it.
        self._corners = np.array(
            [(-half_m, half_m, 0), (half_m, half_m, 0), (half_m, -half_m, 0), (-half_m, -half_m, 0)]
        )

    def detect(self, image_bgr: NDArray[np.uint8]) -> tuple[SeenMarker, ...]:
        """Return the upright markers in a picture, (height, width, 3), each once."""
        grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
        corners, ids, _ = self._detector.detectMarkers(grey)
        numbers = [] if ids is None else [int(each) for each in ids.ravel()]
        found = [
            self._placed(number, np.asarray(each, dtype=float).reshape(4, 2))
            for number, each in zip(numbers, corners, strict=True)
            if numbers.count(number) == 1
        ]
        return tuple(each for each in found if each is not None)

    def _placed(self, number: int, pixels: NDArray[np.float64]) -> SeenMarker | None:
        """Return a marker in `base`; None if it does not stand upright."""
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            self._corners,
            pixels,
            self._matrix,
            self._distortion,
            flags=cv2.SOLVEPNP_IPPE_SQUARE,
        )
        R_base_camera = self._geometry.R_base_camera
        normals = [R_base_camera @ cv2.Rodrigues(turn)[0][:, 2] for turn in turns]
        best = min(range(len(normals)), key=lambda index: abs(normals[index][2]), default=None)
        if best is None or abs(normals[best][2]) > _UPRIGHT:
            return None
        x_m, y_m, _ = R_base_camera @ np.ravel(shifts[best]) + self._geometry.t_base_camera
        into_rad = np.arctan2(-normals[best][1], -normals[best][0])
        return SeenMarker(number, float(x_m), float(y_m), float(into_rad))
