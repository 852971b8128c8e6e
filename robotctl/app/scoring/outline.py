"""How far the outline of a body is from what stands around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled


@compiled
def _from_origin(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the distance of the origin from a segment."""
    x, y = bx - ax, by - ay
    square = x * x + y * y
    share = 0.0 if square == 0.0 else min(max(-(ax * x + ay * y) / square, 0.0), 1.0)
    return float(np.hypot(ax + share * x, ay + share * y))


@compiled
def _is_inside(body: NDArray[np.float64], ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether a part of a segment lies inside of the outline (Cyrus and Beck 1978)."""
    enters, leaves = 0.0, 1.0
    for k in range(len(body)):
        px, py = body[k]
        qx, qy = body[(k + 1) % len(body)]
        depth = (ax - px) * (py - qy) + (ay - py) * (qx - px)  # counter-clockwise: inward
        change = (bx - ax) * (py - qy) + (by - ay) * (qx - px)
        if change > 0.0:
            enters = max(enters, -depth / change)
        elif change < 0.0:
            leaves = min(leaves, -depth / change)
        elif depth < 0.0:
            return False
    return enters < leaves


@compiled
def outline_distance(
    body: NDArray[np.float64],
    sides: NDArray[np.float64],
    x_m: float,
    y_m: float,
    theta_rad: float,
    reach_m: float,
) -> float:
    """Return the distance of a convex outline from the nearest side [m].

    Parameters
    ----------
    body
        Corners in `base`, counter-clockwise, (k, 2) [m].
    sides
        In `world`: x, y, x, y, (n, 4) [m].
    x_m, y_m, theta_rad
        Pose of `base` in `world` [m, rad].
    reach_m
        Sides farther from the origin of `base` do not count [m].

    Returns
    -------
    float
        0 if a side is inside of the outline; inf if none counts.
    """
    least = np.inf
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    for n in range(len(sides)):
        east, north = sides[n, 0] - x_m, sides[n, 1] - y_m
        ax, ay = c * east + s * north, c * north - s * east
        east, north = sides[n, 2] - x_m, sides[n, 3] - y_m
        bx, by = c * east + s * north, c * north - s * east
        if _from_origin(ax, ay, bx, by) >= reach_m:
            continue
        if _is_inside(body, ax, ay, bx, by):
            return 0.0
        for k in range(len(body)):
            px, py = body[k]
            qx, qy = body[(k + 1) % len(body)]
            least = min(
                least,
                _from_origin(ax - px, ay - py, bx - px, by - py),
                _from_origin(px - ax, py - ay, qx - ax, qy - ay),
                _from_origin(px - bx, py - by, qx - bx, qy - by),
            )
    return float(least)
