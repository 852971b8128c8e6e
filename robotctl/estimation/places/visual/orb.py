"""Features of an image.

ORB (Rublee et al., ICCV 2011) as OpenCV has it: 256 bits for each corner, the same from any
direction in the image plane. Images are made smaller first, so that a camera of many pixels gives
the same features as one of few.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.places.visual.features import Features

LONGER_SIDE_PX: Final = 640
"""Image size (longer side) at which features are detected [px]."""
COUNT: Final = 500
"""Features of an image, at most."""
_FAST_THRESHOLD: Final = 10
"""Grey levels by which a corner differs: half of OpenCV's own, for plain walls and little light."""


def features_of(grey: NDArray[np.uint8]) -> Features:
    """Return the features of a grey image, (height, width); a plain wall has none."""
    height, width = grey.shape
    scale = LONGER_SIDE_PX / max(height, width)
    if scale < 1.0:
        size = max(1, round(width * scale)), max(1, round(height * scale))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    orb = cv2.ORB.create(nfeatures=COUNT, fastThreshold=_FAST_THRESHOLD)
    corners, bytes_ = orb.detectAndCompute(grey, None)
    aspect = min(grey.shape) / max(grey.shape)
    if bytes_ is None or not len(corners):
        return Features(np.empty((0, 2)), np.empty((0, 4), np.uint64), aspect)
    points = np.array([corner.pt for corner in corners]) / np.hypot(*grey.shape)
    return Features(points, np.ascontiguousarray(bytes_).view(np.uint64), aspect)


def grey_of(image_bgr: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the grey values of a picture, (height, width, 3) of blue, green and red."""
    return cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
