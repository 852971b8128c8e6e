"""The rule of the occupancy grid as slow loops over all cells: an oracle for the kernels."""

from __future__ import annotations

import math

import numpy as np

GRAZING = math.tan(math.radians(80.0))


def crosses(cell, start, end):
    """Return whether a segment meets the open square [column, column + 1) x [row, row + 1)."""
    row, column = cell
    low, high = 0.0, 1.0
    for near, begin, change in (
        (column, start[0], end[0] - start[0]),
        (row, start[1], end[1] - start[1]),
    ):
        if change == 0.0:
            if not near <= begin < near + 1:
                return False
            continue
        a, b = sorted(((near - begin) / change, (near + 1 - begin) / change))
        low, high = max(low, a), min(high, b)
    return low <= high


def inside(point, a, b, c):
    """Return whether a point lies in a triangle, by the signs of three areas."""

    def area(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    signs = {math.copysign(1.0, area(p, q, point)) for p, q in ((a, b), (b, c), (c, a))}
    return len(signs) == 1


def classify(shape, sensor, angles, ranges, max_range, range_limit, no_echo, fan):  # noqa: C901
    """Return -1 (free), 1 (echo) or 0 for each cell; all lengths in cells, angles increasing."""
    said = np.zeros(shape, int)
    n = len(angles)

    def at(i, length):
        return (
            sensor[0] + length * math.cos(angles[i]),
            sensor[1] + length * math.sin(angles[i]),
        )

    reach, hits = [], set()
    for i, length in enumerate(ranges):
        if math.isnan(length):
            reach.append(-1.0)
        elif math.isinf(length):
            reach.append(min(no_echo, max_range))
        elif length >= max_range or length > range_limit:
            reach.append(min(max_range, range_limit))
        else:
            reach.append(max(0.0, length - math.sqrt(0.5)))
            x, y = at(i, length)
            hits.add((math.floor(y), math.floor(x)))
    triangles, filled = [], [0.0] * n
    pairs = [(i, i + 1) for i in range(n - 1)]
    if n > 2 and 0.0 < (angles[0] - angles[-1]) % (2 * math.pi) <= fan:
        pairs.append((n - 1, 0))
    for i, j in pairs:
        gap = (angles[j] - angles[i]) % (2 * math.pi)
        if min(reach[i], reach[j]) <= 0.0 or gap > fan:
            continue
        near, far = sorted((reach[i], reach[j]))
        if far - near <= GRAZING * math.sin(gap) * near:
            ends = reach[i], reach[j]
        else:
            ends = near, near
        triangles.append((sensor, at(i, ends[0]), at(j, ends[1])))
        filled[i], filled[j] = max(filled[i], ends[0]), max(filled[j], ends[1])
    lines = [(at(i, filled[i]), at(i, reach[i])) for i in range(n) if reach[i] > filled[i]]
    for row in range(shape[0]):
        for column in range(shape[1]):
            centre = (column + 0.5, row + 0.5)
            if (row, column) in hits:
                said[row, column] = 1
            elif any(inside(centre, *triangle) for triangle in triangles) or any(
                crosses((row, column), *line) for line in lines
            ):
                said[row, column] = -1
    return said


def cone(shape, sensor, heading, half_width, distance, band, echo):
    """Return -1, 1 or 0 for each cell of a sonar's cone, by angle and distance of its centre."""
    said = np.zeros(shape, int)
    for row in range(shape[0]):
        for column in range(shape[1]):
            dx, dy = column + 0.5 - sensor[0], row + 0.5 - sensor[1]
            away, off = math.hypot(dx, dy), math.atan2(dy, dx) - heading
            off = abs((off + math.pi) % (2 * math.pi) - math.pi)
            aside = away * math.sin(off)
            if off >= math.pi / 2 or (off > half_width and aside > 0.5):
                continue
            if away < distance - (band if echo else 0.0):
                said[row, column] = -1
            elif echo and away <= distance + band:
                said[row, column] = 1
    return said
