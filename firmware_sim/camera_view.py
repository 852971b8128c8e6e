"""The pixels of a picture: the second half. What a ray meets first, and how that looks."""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.camera_fan import cut
from firmware_sim.camera_floor import LEVELS, PERIOD_M, SIDE
from firmware_sim.compiled import compiled

FLOOR, NOTHING = -1, -2
"""Labels of pixels that show no thing: the floor, and what is above all walls."""
SKY = 205.0
COARSEST = LEVELS - 1
QUANTILES = 4096

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
"""What a pixel is, the same for all pictures."""


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
    plaster: np.ndarray,
    starts: np.ndarray,
    light: np.ndarray,
    light_at: np.ndarray,
    blur: float,
    sigma: np.ndarray,
    quantiles: np.ndarray,
    key: int,
    rows: np.ndarray,
    labels: np.ndarray,
    distances: np.ndarray,
    picture: np.ndarray,
) -> None:
    """Draw a picture row by row; each is finished when the next is known, for the lens's blur.

    Parameters
    ----------
    pose
        x, y of the camera, and cosine and sine of its direction, in world.
    rows
        Room for three rows of light, (3, width, 3).
    labels, distances, picture
        Results: what each pixel shows (number of the thing in the scene), at which level distance
        [m], and its colour.
    """
    n, width = pixels.shape
    for v in range(n + 1):
        if v < n:
            row = rows[v % 3]
            for u in range(width):
                p = pixels[v, u]
                s = p.sector
                distance, label, face, on_top = meet(
                    p, camera_height, local, first, count, height,
                    near[s], thing[s], side[s], listed[s],
                )  # fmt: skip
                labels[v, u] = label
                distances[v, u] = distance
                if label == FLOOR:
                    b, g, r = floor_light(p, pose, floor, starts, light, light_at)
                elif label == NOTHING:
                    b = g = r = SKY
                else:
                    at = camera_height + p.slope * distance
                    bright = thing_light(
                        p, distance, at, on_top, turn, local[face], shade[face], plaster, starts
                    )
                    b = bright * colour[label, 0]
                    g = bright * colour[label, 1]
                    r = bright * colour[label, 2]
                row[u, 0] = p.gain * b
                row[u, 1] = p.gain * g
                row[u, 2] = p.gain * r
        if v > 0:
            above, here, below = rows[max(v - 2, 0) % 3], rows[(v - 1) % 3], rows[min(v, n - 1) % 3]
            finish_row(v - 1, above, here, below, blur, sigma, quantiles, key, picture[v - 1])


@compiled
def meet(
    p: np.ndarray,
    camera_height: float,
    local: np.ndarray,
    first: np.ndarray,
    count: np.ndarray,
    height: np.ndarray,
    near: np.ndarray,
    thing: np.ndarray,
    side: np.ndarray,
    listed: int,
) -> tuple[float, int, int, bool]:
    """Find what a pixel's ray meets first: level distance, label, side, whether on its top."""
    ahead, left, slope = p.ahead, p.left, p.slope  # type: ignore[attr-defined]
    best = float(p.floor)  # type: ignore[attr-defined]
    label = FLOOR if best < np.inf else NOTHING
    face, on_top = -1, False
    for k in range(listed):
        if near[k] >= best:
            break
        o, i = thing[k], side[k]
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
            best, label, face, on_top = enter, o, i, False
        elif slope < 0.0 and camera_height + slope * leave < tall:
            at = (tall - camera_height) / slope
            if at < best:
                best, label, face, on_top = at, o, i, True
    return best, label, face, on_top


@compiled
def thing_light(
    p: np.ndarray,
    distance: float,
    z: float,
    on_top: bool,
    turn: float,
    e: np.ndarray,
    shade: float,
    plaster: np.ndarray,
    starts: np.ndarray,
) -> float:
    """Brightness of a thing where a pixel sees it."""
    along = distance * (e.tx * p.ahead + e.ty * p.left) - e.start  # type: ignore[attr-defined]
    if on_top:
        shade = 1.0
        z = distance * (e.nx * p.ahead + e.ny * p.left) - e.offset  # type: ignore[attr-defined]
    level = 0
    size = distance * turn * (SIDE / PERIOD_M)
    while size > 1.0 and level < COARSEST:
        size *= 0.5
        level += 1
    grain, _, _ = sample(plaster, starts[level], level, along, z)
    return float(shade * grain * (1.0 / 128.0))


@compiled
def floor_light(
    p: np.ndarray,
    pose: np.ndarray,
    floor: np.ndarray,
    starts: np.ndarray,
    light: np.ndarray,
    light_at: np.ndarray,
) -> tuple[float, float, float]:
    """Colour of the floor where a pixel sees it."""
    ahead, left = float(p.ahead), float(p.left)  # type: ignore[attr-defined]
    cx = pose[2] * ahead - pose[3] * left
    cy = pose[3] * ahead + pose[2] * left
    taps, level = p.taps, p.level  # type: ignore[attr-defined]
    step, distance = float(p.step), float(p.floor)  # type: ignore[attr-defined]
    b = g = r = 0.0
    at = distance - 0.5 * (taps - 1) * step
    for _ in range(taps):
        b1, g1, r1 = sample(floor, starts[level], level, pose[0] + at * cx, pose[1] + at * cy)
        b, g, r = b + b1, g + g1, r + r1
        at += step
    x = (pose[0] + distance * cx - light_at[0]) * light_at[2]
    y = (pose[1] + distance * cy - light_at[1]) * light_at[2]
    x = min(max(x, 0.0), light.shape[1] - 1.001)
    y = min(max(y, 0.0), light.shape[0] - 1.001)
    i, j = int(x), int(y)
    x, y = x - i, y - j
    bright = (1.0 - y) * ((1.0 - x) * light[j, i] + x * light[j, i + 1]) + y * (
        (1.0 - x) * light[j + 1, i] + x * light[j + 1, i + 1]
    )
    bright /= taps
    return bright * b, bright * g, bright * r


@compiled
def sample(
    texels: np.ndarray, start: int, level: int, x: float, y: float
) -> tuple[float, float, float]:
    """Interpolate one copy of a pattern between four texels."""
    n = SIDE >> level
    fx = x * (n / PERIOD_M) - 0.5
    fy = y * (n / PERIOD_M) - 0.5
    ix, iy = math.floor(fx), math.floor(fy)
    wx, wy = fx - ix, fy - iy
    i0, i1 = ix & (n - 1), (ix + 1) & (n - 1)
    j0, j1 = start + n * (iy & (n - 1)), start + n * ((iy + 1) & (n - 1))
    w00, w01 = (1.0 - wx) * (1.0 - wy), wx * (1.0 - wy)
    w10, w11 = (1.0 - wx) * wy, wx * wy
    t00, t01, t10, t11 = texels[j0 + i0], texels[j0 + i1], texels[j1 + i0], texels[j1 + i1]
    return (
        w00 * t00[0] + w01 * t01[0] + w10 * t10[0] + w11 * t11[0],
        w00 * t00[1] + w01 * t01[1] + w10 * t10[1] + w11 * t11[1],
        w00 * t00[2] + w01 * t01[2] + w10 * t10[2] + w11 * t11[2],
    )


@compiled
def finish_row(
    v: int,
    above: np.ndarray,
    here: np.ndarray,
    below: np.ndarray,
    blur: float,
    sigma: np.ndarray,
    quantiles: np.ndarray,
    key: int,
    picture: np.ndarray,
) -> None:
    """Blur a row by its neighbours, add the sensor's noise, and round."""
    n = len(here)
    middle = 1.0 - 2.0 * blur
    for u in range(n):
        a, z = max(u - 1, 0), min(u + 1, n - 1)
        # SplitMix64 of the pixel's number: Steele, Lea and Flood, OOPSLA 2014.
        draw = np.uint64(key) + np.uint64(v * n + u + 1) * np.uint64(0x9E3779B97F4A7C15)
        draw = (draw ^ (draw >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        draw = (draw ^ (draw >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        draw = draw ^ (draw >> np.uint64(31))
        for c in range(3):
            value = middle * (middle * here[u, c] + blur * (here[a, c] + here[z, c])) + blur * (
                middle * (above[u, c] + below[u, c])
                + blur * (above[a, c] + above[z, c] + below[a, c] + below[z, c])
            )
            value = min(max(value, 0.0), 255.0)
            noise = quantiles[int(draw & np.uint64(QUANTILES - 1))]
            draw = draw >> np.uint64(12)
            value += sigma[int(value)] * noise + 0.5
            picture[u, c] = int(min(max(value, 0.0), 255.0))
