"""Pictures of walls that look unlike any other."""

import cv2
import numpy as np


def drawn_wall(seed):
    """Draw a wall with many things on it, larger than an image."""
    rng = np.random.default_rng(seed)
    picture = np.full((440, 560), 128, np.uint8)
    for _ in range(150):
        x, y = rng.integers(0, 560), rng.integers(0, 440)
        size = rng.integers(6, 50, 2)
        cv2.rectangle(picture, (x, y), (x + size[0], y + size[1]), int(rng.integers(0, 256)), -1)
    return picture
