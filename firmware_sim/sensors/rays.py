"""Fans of rays against line segments: the geometry that sonar and lidar share.

A fan has n rays at equal angles about its axis. Rather than every ray against every wall, each wall
is tried only with the rays between the bearings of its ends, so the cost depends on what is
visible. All coordinates are in the frame of the fan, x along its axis.
"""

from __future__ import annotations

import math

import numpy as np

from native_kernels.compiled import borrows, compiled


def fan_angles(rays: int, opening_rad: float) -> np.ndarray:
    """Angles of the rays about the axis, (rays,), right to left; a full turn does not close."""
    steps = rays if opening_rad > 2.0 * math.pi - 1.0e-9 else rays - 1
    return -opening_rad / 2.0 + np.arange(rays) * (opening_rad / steps)


@compiled
@borrows
def cast_fan(
    x: float,
    y: float,
    axis_rad: float,
    angles: np.ndarray,
    max_range: float,
    segments: np.ndarray,
    ranges: np.ndarray,
    hits: np.ndarray,
) -> None:
    """Find for each ray the nearest wall.

    Parameters
    ----------
    x, y, axis_rad
        Pose of the fan in world.
    angles
        Angles of the rays about the axis, (n,), from `fan_angles`.
    max_range
        Maximum range [m].
    segments
        Walls, (m, 4).
    ranges, hits
        Results, (n,): range [m], inf without a wall; number of the wall, -1 without one.
    """
    n = len(angles)
    first, spacing = angles[0], angles[1] - angles[0]
    for i in range(n):
        ranges[i] = np.inf
        hits[i] = -1
    cos, sin = math.cos(axis_rad), math.sin(axis_rad)
    # A full turn starts at the fan's back and ends short of it.
    half = -angles[0] if -angles[0] < 0.5 * math.pi else math.pi
    edge_x, edge_y = math.cos(half), math.sin(half)
    for m in range(len(segments)):
        ux, uy = segments[m, 0] - x, segments[m, 1] - y
        ax, ay = cos * ux + sin * uy, -sin * ux + cos * uy
        ux, uy = segments[m, 2] - x, segments[m, 3] - y
        bx, by = cos * ux + sin * uy, -sin * ux + cos * uy
        if half < math.pi:
            left_of_fan = edge_x * ay > edge_y * ax and edge_x * by > edge_y * bx
            right_of_fan = edge_x * ay < -edge_y * ax and edge_x * by < -edge_y * bx
            if left_of_fan or right_of_fan:
                continue
        ex, ey = bx - ax, by - ay
        area = ax * ey - ay * ex
        if area * area > max_range * max_range * (ex * ex + ey * ey):
            continue
        start, end = math.atan2(ay, ax), math.atan2(by, bx)
        if start > end:
            start, end = end, start
        if end - start <= math.pi:
            sweep(start, end, first, spacing, angles, area, ex, ey, m, ranges, hits)
        else:  # Across the fan's back.
            sweep(end, math.pi, first, spacing, angles, area, ex, ey, m, ranges, hits)
            sweep(-math.pi, start, first, spacing, angles, area, ex, ey, m, ranges, hits)
    for i in range(n):
        if ranges[i] > max_range:
            ranges[i] = np.inf
            hits[i] = -1


@compiled
@borrows
def cast_rays(rays: np.ndarray, max_range: float, segments: np.ndarray, ranges: np.ndarray) -> None:
    """Find the nearest wall on each ray from a place of its own.

    Parameters
    ----------
    rays
        x, y and direction in world, (n, 3).
    max_range, segments, ranges
        As of `cast_fan`.
    """
    for i in range(len(rays)):
        x, y = rays[i, 0], rays[i, 1]
        cos, sin = math.cos(rays[i, 2]), math.sin(rays[i, 2])
        ranges[i] = np.inf
        for m in range(len(segments)):
            ux, uy = segments[m, 0] - x, segments[m, 1] - y
            ex, ey = segments[m, 2] - segments[m, 0], segments[m, 3] - segments[m, 1]
            across = cos * ey - sin * ex
            if across == 0.0:
                continue
            away, share = (ux * ey - uy * ex) / across, (ux * sin - uy * cos) / across
            if 0.0 <= share <= 1.0 and 0.0 <= away < ranges[i]:
                ranges[i] = away
        if ranges[i] > max_range:
            ranges[i] = np.inf


@compiled
@borrows
def sweep(
    start: float,
    end: float,
    first: float,
    spacing: float,
    angles: np.ndarray,
    area: float,
    ex: float,
    ey: float,
    wall: int,
    ranges: np.ndarray,
    hits: np.ndarray,
) -> None:
    """Try the rays from one bearing to another on a wall with direction e."""
    low = max(math.ceil((start - first) / spacing - 1.0e-9), 0)
    high = min(math.floor((end - first) / spacing + 1.0e-9), len(angles) - 1)
    for i in range(low, high + 1):
        across = math.cos(angles[i]) * ey - math.sin(angles[i]) * ex
        distance = area / across if across != 0.0 else np.inf
        if 0.0 <= distance < ranges[i]:
            ranges[i] = distance
            hits[i] = wall


@compiled
@borrows
def blocked(ax: float, ay: float, bx: float, by: float, segments: np.ndarray) -> bool:
    """Whether a wall stands between two points; one that only touches an end does not."""
    dx, dy = bx - ax, by - ay
    for m in range(len(segments)):
        px, py = segments[m, 0] - ax, segments[m, 1] - ay
        ex, ey = segments[m, 2] - segments[m, 0], segments[m, 3] - segments[m, 1]
        across = dx * ey - dy * ex
        if across == 0.0:
            continue
        t = (px * ey - py * ex) / across
        u = (px * dy - py * dx) / across
        if 1.0e-6 < t < 1.0 - 1.0e-6 and 0.0 <= u <= 1.0:
            return True
    return False
