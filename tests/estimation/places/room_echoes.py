"""What ideal sonars hear at a place of a room: the nearest wall point in each cone."""

import math

import numpy as np

from robotctl.estimation.places.signatures import SignatureConfig, signature_of

CONFIG = SignatureConfig()
CONE_RAD = math.radians(12.5)
INCIDENCE_RAD = math.radians(35.0)

L_ROOM = [
    (0, 0, 6, 0), (6, 0, 6, 3), (6, 3, 3, 3), (3, 3, 3, 5), (3, 5, 0, 5), (0, 5, 0, 0),
    (1.0, 3.5, 1.6, 3.5), (1.6, 3.5, 1.6, 4.2), (4.6, 1.2, 5.0, 1.6),
]  # fmt: skip
SQUARE = [(0, 0, 3, 0), (3, 0, 3, 3), (3, 3, 0, 3), (0, 3, 0, 0)]


def heard(walls, x, y, theta, *, noise=None, rays=15):
    """Return the signature of a cone turned in small steps around a point."""
    bearings = np.arange(720) * math.tau / 720
    depths = np.full(len(bearings), np.inf)
    for x1, y1, x2, y2 in walls:
        dx, dy = x2 - x1, y2 - y1
        for off in np.linspace(-CONE_RAD, CONE_RAD, rays):
            c, s = np.cos(theta + bearings + off), np.sin(theta + bearings + off)
            across = c * dy - s * dx
            with np.errstate(divide="ignore", invalid="ignore"):
                along = ((x1 - x) * dy - (y1 - y) * dx) / across
                share = ((x1 - x) * s - (y1 - y) * c) / across
            flat = np.abs(across) < math.hypot(dx, dy) * math.cos(INCIDENCE_RAD)
            hit = (along > 0.0) & (share >= 0.0) & (share <= 1.0) & ~flat
            depths = np.where(hit & (along < depths), along, depths)
    if noise is not None:
        depths = depths + 0.01 * noise.standard_normal(len(depths))
    return signature_of(bearings, depths, CONFIG)
