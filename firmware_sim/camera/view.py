"""The pixels of a picture, its second half: the first hit of each ray, and its appearance."""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.camera.board import add_board
from firmware_sim.camera.fan import cut
from firmware_sim.camera.floor import LEVELS, PERIOD_M, PIECES, SIDE
from native_kernels.compiled import borrows, compiled

NO_SLOT = -1
FLOOR, NOTHING = -1, -2
"""Labels of pixels without an object: the floor, and everything above all walls."""
SKY = 205.0
COARSEST = LEVELS - 1
QUANTILES = 4096
FAR = 1024
"""Maximum extent of a world to either side of its origin [periods of a pattern]."""

PIXEL = np.dtype(
    [
        ("ahead", np.float32),  # unit vector of the level direction
        ("left", np.float32),
        ("slope", np.float32),  # rise over level distance
        ("floor", np.float32),  # level distance at which it meets the floor [m], inf: never
        ("gain", np.float32),  # exposure and vignetting
        ("step", np.float32),  # level distance between the samples of the floor [m]
        ("sector", np.int32),
        ("level", np.uint8),  # of the floor's copies
        ("taps", np.uint8),  # samples of the floor along the ray
    ]
)
"""Properties of a pixel, the same for all pictures."""


@compiled
def draw(
    pose: np.ndarray,
    camera_height: float,
    turn: float,
    pixels: np.ndarray,
    local: np.ndarray,
    first: np.ndarray,
    count: np.ndarray,
    height: np.ndarray,
    colour: np.ndarray,
    shade: np.ndarray,
    near: np.ndarray,
    thing: np.ndarray,
    side: np.ndarray,
    listed: np.ndarray,
    floor: np.ndarray,
    size: np.ndarray,
    shift: np.ndarray,
    cuts: np.ndarray,
    plaster: np.ndarray,
    prints: np.ndarray,
    slots: np.ndarray,
    first_slot: np.ndarray,
    slots_per_m: np.ndarray,
    starts: np.ndarray,
    light: np.ndarray,
    light_at: np.ndarray,
    boards: np.ndarray,
    blur: float,
    sigma: np.ndarray,
    quantiles: np.ndarray,
    key: int,
    rows: np.ndarray,
    labels: np.ndarray,
    distances: np.ndarray,
    picture: np.ndarray,
) -> None:
    """Draw a picture row by row.

    Parameters
    ----------
    pose
        x, y of the camera, and cosine and sine of its direction, in world.
    rows
        Room for four rows of light, (4, 3 * width).
    labels, distances, picture
        Results: what each pixel shows (number of the thing in the scene), at which level distance
        [m], and its colour, (height, 3 * width).
    """
    n, width = pixels.shape
    faces = np.empty(width, dtype=np.int32)
    bright = np.empty(width)
    for v in range(n + 1):
        if v < n:
            # Whole rows at a time: a call with many arrays costs more than a pixel.
            meet(pixels[v], camera_height, local, first, count, height, near, thing, side, listed,
                 labels[v], distances[v], faces)  # fmt: skip
            floor_row(pixels[v], labels[v], pose, floor, size, shift, cuts, starts, light,
                      light_at, bright, rows[v % 3])  # fmt: skip
            for k in range(len(boards)):
                add_board(boards[k], pixels[v], labels[v] == FLOOR, pose, camera_height, turn,
                          bright, rows[v % 3])  # fmt: skip
            thing_row(pixels[v], labels[v], distances[v], faces, pose, camera_height, turn,
                      local, shade, colour, plaster, prints, slots, first_slot, slots_per_m,
                      starts, rows[v % 3])  # fmt: skip
        if v > 0:
            # A row is finished once the next is known.
            blur_rows(
                rows[max(v - 2, 0) % 3], rows[(v - 1) % 3], rows[min(v, n - 1) % 3], blur, rows[3]
            )
            expose_row(v - 1, rows[3], sigma, quantiles, key, picture[v - 1])


@compiled
@borrows
def meet(
    pixels: np.ndarray,
    camera_height: float,
    local: np.ndarray,
    first: np.ndarray,
    count: np.ndarray,
    height: np.ndarray,
    near: np.ndarray,
    thing: np.ndarray,
    side: np.ndarray,
    listed: np.ndarray,
    labels: np.ndarray,
    distances: np.ndarray,
    faces: np.ndarray,
) -> None:
    """Find the first hit of the rays of a row: label, level distance, and side, or -1 for a top."""
    for u in range(len(pixels)):
        p = pixels[u]
        best = float(p.floor)
        label = FLOOR if best < np.inf else NOTHING
        face = -1
        s = p.sector
        for k in range(listed[s]):
            if near[s, k] >= best:
                break
            ahead, left, slope = float(p.ahead), float(p.left), float(p.slope)
            o, i = thing[s, k], side[s, k]
            tall = height[o]
            if i >= 0 and tall >= camera_height:
                e = local[i]
                enter = e.offset / (e.nx * ahead + e.ny * left)
                leave = enter
            else:
                enter, leave, i = cut(ahead, left, first[o], count[o], local)
            if enter >= best:
                continue
            if camera_height + slope * enter <= tall:
                best, label, face = enter, o, i
            elif slope < 0.0 and camera_height + slope * leave < tall:
                at = (tall - camera_height) / slope
                if at < best:
                    best, label, face = at, o, -1
        labels[u] = label
        distances[u] = best
        faces[u] = face


@compiled
@borrows
def floor_row(
    pixels: np.ndarray,
    labels: np.ndarray,
    pose: np.ndarray,
    floor: np.ndarray,
    size: np.ndarray,
    shift: np.ndarray,
    cuts: np.ndarray,
    starts: np.ndarray,
    light: np.ndarray,
    light_at: np.ndarray,
    brights: np.ndarray,
    row: np.ndarray,
) -> None:
    """Light of the pixels of a row that show the floor, and of those that show nothing.

    `brights` gets the light on the floor, times the gain of its pixel.
    """
    last_x, last_y = light.shape[1] - 1.001, light.shape[0] - 1.001
    wide, deep = size[0], size[1]
    low_x = low_y = np.inf
    cut_x = cut_y = 0.0
    for u in range(len(pixels)):
        p = pixels[u]
        if labels[u] != FLOOR:
            row[3 * u] = row[3 * u + 1] = row[3 * u + 2] = p.gain * SKY
            continue
        cx = pose[2] * p.ahead - pose[3] * p.left
        cy = pose[3] * p.ahead + pose[2] * p.left
        step, level = float(p.step), p.level
        start = starts[level]
        b = g = r = 0.0
        at = p.floor - 0.5 * (p.taps - 1) * step
        for _ in range(p.taps):
            x, y = pose[0] + at * cx, pose[1] + at * cy
            if not (low_x <= x < low_x + wide and low_y <= y < low_y + deep):
                # Another piece of the floor.
                j = math.floor(y / deep)
                low_y = j * deep
                j &= PIECES - 1
                i = math.floor((x + shift[j]) / wide)
                low_x = i * wide - shift[j]
                i &= PIECES - 1
                cut_x, cut_y = cuts[j, i, 0] - low_x, cuts[j, i, 1] - low_y
            b1, g1, r1 = sample(floor, start, level, cut_x + x, cut_y + y)
            b, g, r = b + b1, g + g1, r + r1
            at += step
        x = (pose[0] + p.floor * cx - light_at[0]) * light_at[2]
        y = (pose[1] + p.floor * cy - light_at[1]) * light_at[2]
        x, y = min(max(x, 0.0), last_x), min(max(y, 0.0), last_y)
        i, j = int(x), int(y)
        x, y = x - i, y - j
        bright = (1.0 - y) * ((1.0 - x) * light[j, i] + x * light[j, i + 1]) + y * (
            (1.0 - x) * light[j + 1, i] + x * light[j + 1, i + 1]
        )
        brights[u] = bright * p.gain
        bright *= p.gain / p.taps
        row[3 * u] = bright * b
        row[3 * u + 1] = bright * g
        row[3 * u + 2] = bright * r


@compiled
@borrows
def thing_row(
    pixels: np.ndarray,
    labels: np.ndarray,
    distances: np.ndarray,
    faces: np.ndarray,
    pose: np.ndarray,
    camera_height: float,
    turn: float,
    local: np.ndarray,
    shade: np.ndarray,
    colour: np.ndarray,
    plaster: np.ndarray,
    prints: np.ndarray,
    slots: np.ndarray,
    first_slot: np.ndarray,
    slots_per_m: np.ndarray,
    starts: np.ndarray,
    row: np.ndarray,
) -> None:
    """Light of the pixels of a row that show things."""
    per_px = turn * (SIDE / PERIOD_M)
    for u in range(len(pixels)):
        label = labels[u]
        if label < 0:
            continue
        p = pixels[u]
        distance = distances[u]
        slot = NO_SLOT
        if faces[u] >= 0:
            i = faces[u]
            e = local[i]
            along = distance * (e.tx * p.ahead + e.ty * p.left) - e.start
            up = camera_height + p.slope * distance
            bright = shade[i]
            if slots_per_m[i] > 0.0:
                slot = first_slot[i] + int(along * slots_per_m[i])
        else:
            along = pose[0] + distance * (pose[2] * p.ahead - pose[3] * p.left)
            up = pose[1] + distance * (pose[3] * p.ahead + pose[2] * p.left)
            bright = 1.0
        level = 0
        size = distance * per_px
        while size > 1.0 and level < COARSEST:
            size *= 0.5
            level += 1
        bright *= p.gain
        if slot != NO_SLOT:
            s = slots[slot]
            if s.left < along < s.right and s.low < up < s.high:
                b, g, r = sample(prints, starts[level], level, along + s.x, up + s.y)
                bright *= b * s.first + g * s.second + r * s.third
                row[3 * u] = bright * s.blue
                row[3 * u + 1] = bright * s.green
                row[3 * u + 2] = bright * s.red
                continue
        grain, _, _ = sample(plaster, starts[level], level, along, up)
        bright *= grain * (1.0 / 128.0)
        for c in range(3):
            row[3 * u + c] = bright * colour[label, c]


@compiled
@borrows
def sample(
    texels: np.ndarray, start: int, level: int, x: float, y: float
) -> tuple[float, float, float]:
    """Interpolate one copy of a pattern between four texels."""
    n = SIDE >> level
    scale = n / PERIOD_M
    # Shifted by whole periods, so that all are positive; weights in 1/256.
    fx, fy = x * scale + (FAR * n - 0.5), y * scale + (FAR * n - 0.5)
    ix, iy = int(fx), int(fy)
    wx, wy = int(256.0 * (fx - ix)), int(256.0 * (fy - iy))
    i0, i1 = ix & (n - 1), (ix + 1) & (n - 1)
    j0, j1 = start + n * (iy & (n - 1)), start + n * ((iy + 1) & (n - 1))
    w11 = (wx * wy) >> 8
    w01, w10 = wx - w11, wy - w11
    w00 = 256 - wx - w10
    # Blue and red are far enough apart to be weighted together.
    t00, t01 = np.int64(texels[j0 + i0]), np.int64(texels[j0 + i1])
    t10, t11 = np.int64(texels[j1 + i0]), np.int64(texels[j1 + i1])
    both = w00 * (t00 & 0xFF00FF) + w01 * (t01 & 0xFF00FF)
    both += w10 * (t10 & 0xFF00FF) + w11 * (t11 & 0xFF00FF)
    g = w00 * ((t00 >> 8) & 0xFF) + w01 * ((t01 >> 8) & 0xFF)
    g += w10 * ((t10 >> 8) & 0xFF) + w11 * ((t11 >> 8) & 0xFF)
    return (both & 0xFFFF) / 256.0, g / 256.0, (both >> 16) / 256.0


@compiled
def blur_rows(
    above: np.ndarray, here: np.ndarray, below: np.ndarray, blur: float, row: np.ndarray
) -> None:
    """Blur a row of light by its neighbours, into `row`; all (3 * width,)."""
    n = len(here)
    aside, middle = np.float32(blur), np.float32(1.0 - 2.0 * blur)
    column = np.empty(n + 6, dtype=np.float32)
    for i in range(n):
        column[i + 3] = middle * here[i] + aside * (above[i] + below[i])
    column[0:3] = column[3:6]
    column[n + 3 :] = column[n : n + 3]
    for i in range(n):
        row[i] = middle * column[i + 3] + aside * (column[i] + column[i + 6])


@compiled
@borrows
def expose_row(
    v: int,
    row: np.ndarray,
    sigma: np.ndarray,
    quantiles: np.ndarray,
    key: int,
    picture: np.ndarray,
) -> None:
    """Add the sensor's noise to a row of light, and round."""
    n = len(row) // 3
    part, mask = np.uint64(12), np.uint64(QUANTILES - 1)
    for u in range(n):
        # SplitMix64 of the pixel's number: Steele, Lea and Flood, OOPSLA 2014.
        draw = np.uint64(key) + np.uint64(v * n + u + 1) * np.uint64(0x9E3779B97F4A7C15)
        draw = (draw ^ (draw >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        draw = (draw ^ (draw >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        draw = draw ^ (draw >> np.uint64(31))
        for c in range(3):
            value = min(max(row[3 * u + c], np.float32(0.0)), np.float32(255.0))
            value += sigma[np.uint64(value)] * quantiles[draw & mask] + np.float32(0.5)
            draw = draw >> part
            picture[3 * u + c] = np.uint8(min(max(value, np.float32(0.0)), np.float32(255.0)))
