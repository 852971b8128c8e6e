"""Things in each direction from the camera: the first half of a picture.

The plane about the camera is cut into narrow sectors. Each lists, nearest first, the objects that
may be hit in it, up to one that hides everything behind it. Where a single side of a thing spans a
sector, that side is noted, and a ray is cut with it alone; elsewhere with all sides of the thing.
So the cuts are exact for every ray, and only their candidates come from the sectors.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.camera.scene import AX, AY, LENGTH, NX, NY, Scene
from native_kernels.compiled import borrows, compiled

ROOM = 48
"""Maximum things that a sector lists; the farthest are left out."""
SIDES = np.dtype(
    [(name, np.float64) for name in ("nx", "ny", "offset", "tx", "ty", "start", "length", "near")]
)
"""A side in the fan's frame: outward normal n, n·a, unit vector t along it, t·a, length, and the
distance of its nearer end."""


class Fan:
    """The sectors about a camera, for one scene.

    Parameters
    ----------
    scene
        The objects.
    sectors
        Number of sectors of the full turn.
    height_m
        Height of the camera above the floor.
    steepest
        Greatest slope of all rays: an object lower than a ray hides nothing.

    Attributes
    ----------
    local
        The sides in the fan's frame, (n,) of `SIDES`.
    near, thing, side
        Candidates of each sector, (sectors, ROOM): a lower bound of the distance [m], number of
        the thing, number of the side that spans the sector or -1.
    listed
        Number of candidates of each sector.
    """

    def __init__(self, scene: Scene, sectors: int, height_m: float, steepest: float) -> None:
        self._scene = scene
        self._height_m = height_m
        self._steepest = max(steepest, 0.0)
        edges = -math.pi + np.arange(sectors + 1) * (2.0 * math.pi / sectors)
        self._edges = np.stack([np.cos(edges), np.sin(edges)], axis=1)
        self.local = np.zeros(len(scene.sides), dtype=SIDES)
        self.near = np.zeros((sectors, ROOM))
        self.thing = np.zeros((sectors, ROOM), dtype=np.int32)
        self.side = np.zeros((sectors, ROOM), dtype=np.int32)
        self.listed = np.zeros(sectors, dtype=np.int32)
        self._cover = np.zeros(sectors)

    def turn(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Look from a place in a direction, both in world."""
        scene = self._scene
        fill_fan(
            scene.sides,
            scene.owner,
            scene.count,
            scene.height,
            x_m,
            y_m,
            heading_rad,
            self._height_m,
            self._steepest,
            self._edges,
            self.local,
            self.near,
            self.thing,
            self.side,
            self.listed,
            self._cover,
        )


@compiled
@borrows
def fill_fan(
    sides: np.ndarray,
    owner: np.ndarray,
    count: np.ndarray,
    height: np.ndarray,
    x: float,
    y: float,
    heading: float,
    camera_height: float,
    steepest: float,
    edges: np.ndarray,
    local: np.ndarray,
    near: np.ndarray,
    thing: np.ndarray,
    side: np.ndarray,
    listed: np.ndarray,
    cover: np.ndarray,
) -> None:
    """Transform all sides and fill the sectors."""
    cos, sin = math.cos(heading), math.sin(heading)
    listed[:] = 0
    cover[:] = np.inf
    sectors = len(listed)
    width = 2.0 * math.pi / sectors
    shrink = math.cos(width)
    for i in range(len(sides)):
        row = sides[i]
        e = local[i]
        dx, dy = row[AX] - x, row[AY] - y
        ax, ay = cos * dx + sin * dy, -sin * dx + cos * dy
        e.nx = cos * row[NX] + sin * row[NY]
        e.ny = -sin * row[NX] + cos * row[NY]
        e.tx, e.ty = -e.ny, e.nx
        e.offset = e.nx * ax + e.ny * ay
        e.start = e.tx * ax + e.ty * ay
        e.length = row[LENGTH]
        if e.offset >= 0.0 and count[owner[i]] > 1:
            continue  # seen from behind
        bx, by = ax + e.tx * e.length, ay + e.ty * e.length
        along = min(max(-e.start, 0.0), e.length)
        e.near = math.hypot(ax + along * e.tx, ay + along * e.ty)
        if e.near < 1.0e-9:
            continue
        begin = math.atan2(ay, ax)
        sweep = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        if sweep < 0.0:
            begin += sweep
            sweep = -sweep
            ax, ay, bx, by = bx, by, ax, ay
        first = math.floor((begin + math.pi) / width)
        last = math.floor((begin + sweep + math.pi) / width)
        tall = height[owner[i]]
        for k in range(first, last + 1):
            s = k % sectors
            if first < k < last:
                low = e.offset / (e.nx * edges[s, 0] + e.ny * edges[s, 1])
                high = e.offset / (e.nx * edges[s + 1, 0] + e.ny * edges[s + 1, 1])
                far = max(low, high)
                put(s, min(low, high) * shrink, owner[i], i, near, thing, side, listed, cover)
                if far < cover[s] and tall >= camera_height + steepest * far:
                    cover[s] = far
            else:
                put(s, e.near, owner[i], -1, near, thing, side, listed, cover)


@compiled
@borrows
def put(
    s: int,
    distance: float,
    owner: int,
    spanning: int,
    near: np.ndarray,
    thing: np.ndarray,
    side: np.ndarray,
    listed: np.ndarray,
    cover: np.ndarray,
) -> None:
    """Insert a candidate into the list of a sector, in the order of distance."""
    if distance > cover[s]:
        return
    at = listed[s]
    if at == ROOM:
        if distance >= near[s, ROOM - 1]:
            return
        at = ROOM - 1
    else:
        listed[s] = at + 1
    while at > 0 and near[s, at - 1] > distance:
        near[s, at] = near[s, at - 1]
        thing[s, at] = thing[s, at - 1]
        side[s, at] = side[s, at - 1]
        at -= 1
    near[s, at] = distance
    thing[s, at] = owner
    side[s, at] = spanning


@compiled
@borrows
def cut(
    ahead: float, left: float, first: int, count: int, local: np.ndarray
) -> tuple[float, float, int]:
    """Intersect a ray with all sides of a thing: entry and exit distance, and side of entry.

    Returns inf, inf, -1 where it misses, or begins inside.
    """
    if count == 1:
        e = local[first]
        distance = e.offset / (e.nx * ahead + e.ny * left)
        along = distance * (e.tx * ahead + e.ty * left) - e.start
        if distance > 0.0 and 0.0 <= along <= e.length:
            return distance, distance, first
        return np.inf, np.inf, -1
    enter, leave, by = 0.0, np.inf, -1
    for i in range(first, first + count):
        e = local[i]
        across = e.nx * ahead + e.ny * left
        if across < 0.0:
            distance = e.offset / across
            if distance > enter:
                enter, by = distance, i
        elif across > 0.0:
            leave = min(leave, e.offset / across)
        elif e.offset < 0.0:
            return np.inf, np.inf, -1
    if by < 0 or enter >= leave:
        return np.inf, np.inf, -1
    return enter, leave, by
