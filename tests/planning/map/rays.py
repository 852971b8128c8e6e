"""A lidar and a sonar among walls and discs, by textbook geometry."""

from __future__ import annotations

import math

import numpy as np

from robotctl.model.geometry.se2 import SE2
from robotctl.model.sensors.range_scan import RangeScan


def box(x0, y0, x1, y1):
    """Return the four walls of a box."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


def ranges(x, y, angles, walls=(), discs=()):
    """Return how far rays from a point go: walls (n, 4) end to end, discs (n, 3) x, y, radius."""
    d = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    best = np.full(len(angles), np.inf)
    for x0, y0, x1, y1 in walls:
        side, to = np.array([x1 - x0, y1 - y0]), np.array([x0 - x, y0 - y])
        across = d[:, 0] * side[1] - d[:, 1] * side[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (to[0] * side[1] - to[1] * side[0]) / across
            u = (to[0] * d[:, 1] - to[1] * d[:, 0]) / across
        hit = (t > 0.0) & (u >= 0.0) & (u <= 1.0)
        best[hit] = np.minimum(best[hit], t[hit])
    for cx, cy, radius in discs:
        along = d @ (cx - x, cy - y)
        off2 = (cx - x) ** 2 + (cy - y) ** 2 - along**2
        hit = (off2 < radius**2) & (along > 0.0)
        best[hit] = np.minimum(best[hit], along[hit] - np.sqrt(radius**2 - off2[hit]))
    return best


def scan(pose, walls=(), discs=(), *, beams=360, max_range_m=12.0, stamp_ns=0, noise=None):
    """Return a lidar's scan all around; `noise` is a generator: 1 cm."""
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    r = ranges(pose.x_m, pose.y_m, angles + pose.theta_rad, walls, discs)
    if noise is not None:
        r = np.maximum(r + noise.normal(0.0, 0.01, beams), 0.0)
    return RangeScan(stamp_ns, angles, np.where(r < max_range_m, r, np.inf), max_range_m)


def echo(pose, mount, walls=(), discs=(), *, beam_deg=25.0, incidence_deg=35.0):
    """Return a sonar's range: the nearest surface in its cone that is not too slanting."""
    sensor = pose @ SE2(mount.x_m, mount.y_m, mount.heading_rad)
    half = math.radians(0.5 * beam_deg)
    angles = sensor.theta_rad + np.linspace(-half, half, 101)
    best = math.inf
    for wall in walls:
        x0, y0, x1, y1 = wall
        normal = math.atan2(x0 - x1, y1 - y0)
        away = ranges(sensor.x_m, sensor.y_m, angles, [wall])
        off = np.abs(np.mod(angles - normal + 0.5 * math.pi, math.pi) - 0.5 * math.pi)
        heard = off <= math.radians(incidence_deg)
        best = min(best, away[heard].min(initial=math.inf))
    # A wall's end throws sound back in all directions.
    ends = [(w[0], w[1], 0.01) for w in walls] + [(w[2], w[3], 0.01) for w in walls]
    return min(best, ranges(sensor.x_m, sensor.y_m, angles, (), [*discs, *ends]).min())
