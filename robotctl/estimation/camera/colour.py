"""The floor's appearance: densities of colour, learned from the free patch.

A colour is log brightness and two log ratios of its channels. A nearer lamp, a shadow or another
exposure changes all channels equally, also behind the camera's gamma, so it moves the brightness
and leaves the ratios. Densities are histograms, so tiles of two colours are no special case (Ulrich
and Nourbakhsh 2000, "Appearance-based obstacle detection with monocular color vision", learn them
from the area before the robot). Anything above the horizon cannot be floor: its colours are
evidence for an obstacle.
"""

from __future__ import annotations

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from native_kernels.compiled import compiled

# One bin of brightness and of each ratio, squeezed, and how many.
L_STEP: Final = 0.07
C_STEP: Final = 0.02
L_BINS: Final = 52
C_BINS: Final = 64
_DARK_OFFSET: Final = 10.0
"""Added to a channel of 0 to 255 before its logarithm: dark pixels are mostly noise."""
_PER_LEVEL: Final = 4
"""Logarithms are looked up in steps of this fraction of a level of 255."""

SHADOWED: Final = -0.25
"""Evidence of floor if it lies in a shadow."""
LIT: Final = -0.125
"""Evidence of floor if it lies in more light."""
_SURE: Final = 3.0
"""Evidence stays within this and its negative, natural logarithms of odds."""
_LIGHT_BINS: Final = 12
"""Maximum ratio of light on the floor: 2.3 in stored values, 6 in linear ones."""
_SHADE_WEIGHT: Final = 0.1
_SUN_WEIGHT: Final = 0.03
"""Share of floor in a sharp shadow, and in the sun, against that in the light of the patch."""
_BRIGHTER_BINS: Final = 2
"""Brightness margin of floor in the same light above any of the patch."""
_LOG_RARE: Final = math.log(1e-3)
"""Floor of a colour that it was never seen in, against an obstacle of that colour."""
_LOG_HALF: Final = math.log(0.5)
_DRIFT_HALF: Final = 10
"""Columns to either side used to judge the light of a place."""
_DRIFT_GAIN: Final = 0.15
"""Gain in mean likelihood of its cells that changes the light of a row."""


def _logarithms() -> NDArray[np.float32]:
    """Return log(level + offset) for levels of 0 to 255 in steps."""
    return np.log(np.arange(_PER_LEVEL * 255 + 1) / _PER_LEVEL + _DARK_OFFSET).astype(np.float32)


_LOGS: Final = _logarithms()
_L_LEAST: Final = float(_LOGS[0])
_FULL: Final = float(_LOGS[_PER_LEVEL * 246])
SATURATED_BIN: Final = int((_FULL - _L_LEAST) / L_STEP)
"""Brightness from here on is that of overexposed pixels."""
# Rows of the densities.
FLOOR, SHADE, SUN, FULL, THING, WALL = range(6)
_SHAPE: Final = (C_BINS, C_BINS, L_BINS)


def colour_bins(
    strip: NDArray[np.uint8], edges: NDArray[np.intp], halves: NDArray[np.intp]
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Return mean colours of the strip on a coarser grid, and their bins.

    Fine texture, joints of tiles and noise average out, an obstacle does not.

    Parameters
    ----------
    strip
        BGR, (rows, 2 columns, 3).
    edges
        Rows at which the coarse rows begin and, last, end, (n + 1,).
    halves
        Columns to either side that are averaged as well, (n,).

    Returns
    -------
    tuple
        Mean BGR, (n, columns, 3), and places in a flat histogram, (n, columns).
    """
    columns = strip.shape[1] // 2
    means = np.empty((len(halves), columns, 3), np.float32)
    bins = np.empty((len(halves), columns), np.int32)
    _colour_bins(strip, edges, halves, _LOGS, means, bins)
    return means, bins


def count(bins: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the share of each bin, (bins,); zeros where nothing is given."""
    counted = np.bincount(bins, minlength=C_BINS * C_BINS * L_BINS).astype(np.float32)
    return counted / np.float32(max(1, len(bins)))


def shifted(shares: NDArray[np.float32], steps: int) -> NDArray[np.float32]:
    """Return the shares of the same colours, brighter by some bins."""
    cube = shares.reshape(_SHAPE)
    moved = np.zeros_like(cube)
    if steps >= 0:
        moved[:, :, steps:] = cube[:, :, : L_BINS - steps]
    else:
        moved[:, :, :steps] = cube[:, :, -steps:]
    return moved.reshape(-1)


def brightness(shares: NDArray[np.float32]) -> float:
    """Return the mean brightness of a histogram, in bins."""
    along = shares.reshape(-1, L_BINS).sum(axis=0)
    return float(along @ np.arange(L_BINS)) / max(1e-9, float(along.sum()))


def smoothed(shares: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the density of colours: shares spread over their neighbours."""
    # A picture of ratios with one channel for each brightness, then one of brightness by ratios.
    cube = cv2.GaussianBlur(shares.reshape(_SHAPE), (5, 5), 1.1, borderType=cv2.BORDER_REPLICATE)
    flat = cube.reshape(-1, L_BINS)
    return np.asarray(
        cv2.GaussianBlur(flat, (5, 1), 1.0, borderType=cv2.BORDER_REPLICATE), np.float32
    ).reshape(-1)


def overlap(one: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """Return how much two densities have in common, 0 to 1 (histogram intersection)."""
    return float(np.minimum(one, other).sum())


def log_densities(
    floor: NDArray[np.float32], above: NDArray[np.float32], log_prior: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the logarithms of each colour's densities, (6, bins).

    Parameters
    ----------
    floor, above
        Densities of the floor and of everything above the horizon, (bins,).
    log_prior
        Of `log_obstacle_prior`, (bins,).

    Returns
    -------
    ndarray
        Rows `FLOOR`: floor in the light of the patch; `SHADE` and `SUN`: floor in less or more
        light; `FULL`: overexposed floor; `THING`: any obstacle; `WALL`: what may reach above the
        horizon.
    """
    # Dark pixels are noisy, and what light is left may have another colour.
    shades = cv2.blur(floor.reshape(_SHAPE), (3, 3), borderType=cv2.BORDER_REPLICATE).reshape(-1)
    logs = np.empty((6, len(floor)), np.float32)
    _log_densities(floor, np.asarray(shades, np.float32), above, log_prior, logs)
    return logs


def evidence(
    logs: NDArray[np.float32], bins: NDArray[np.int32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the cells' evidence for an obstacle, given their illumination.

    Light changes slowly over the floor, apart from the edges of shadows. From row to row it is
    taken as a step of brightness brighter or darker where the floor's colours fit better so.

    Parameters
    ----------
    logs
        Of `log_densities`.
    bins
        Colours of the cells, nearest row first, (n, columns).

    Returns
    -------
    tuple
        log(p(colour | obstacle) / p(colour | floor)), (n, columns), within 3, exactly `SHADOWED`
        or `LIT` for what is floor if it is in a shadow or in the sun: for any obstacle, and for
        one that reaches above the horizon.
    """
    found = np.empty((2, *bins.shape), np.float32)
    _evidence(logs, bins, found)
    return found[0], found[1]


def log_obstacle_prior() -> NDArray[np.float32]:
    """Return the log density of obstacles' colours: any brightness, rather grey than not."""
    squeezed = (np.arange(C_BINS) - C_BINS // 2) * C_STEP
    ratio = squeezed / (1.0 - np.abs(squeezed))
    one = 0.5 * np.exp(-0.5 * (ratio / 0.15) ** 2) + 0.1
    cube = np.repeat((one[:, None] * one)[:, :, None], L_BINS, axis=2)
    return np.asarray(np.log(cube / cube.sum()), np.float32).reshape(-1)


@compiled
def _colour_bins(
    strip: NDArray[np.uint8],
    edges: NDArray[np.intp],
    halves: NDArray[np.intp],
    logs: NDArray[np.float32],
    means: NDArray[np.float32],
    bins: NDArray[np.int32],
) -> None:
    """Fill `means` and `bins`: sums down the rows, then running sums along them."""
    n, columns, _ = means.shape
    flat = strip.reshape(len(strip), -1)
    sums = np.empty(flat.shape[1], np.int32)
    running = np.zeros((columns + 1, 3), np.int32)
    for i in range(n):
        sums[:] = 0
        for row in range(edges[i], edges[i + 1]):
            line = flat[row]
            for k in range(len(sums)):
                sums[k] += line[k]
        for column in range(columns):
            for k in range(3):
                both = sums[6 * column + k] + sums[6 * column + 3 + k]
                running[column + 1, k] = running[column, k] + both
        half, height = halves[i], 2 * (edges[i + 1] - edges[i])
        for column in range(columns):
            left, right = max(column - half, 0), min(column + half + 1, columns)
            share = np.float32(1.0) / np.float32(height * (right - left))
            for k in range(3):
                means[i, column, k] = np.float32(running[right, k] - running[left, k]) * share
            bins[i, column] = _bin(means[i, column], logs)


@compiled
def _bin(colour: NDArray[np.float32], logs: NDArray[np.float32]) -> int:
    """Return the bin of a colour, BGR."""
    scale, half = np.float32(_PER_LEVEL), np.float32(0.5)
    b = logs[int(colour[0] * scale + half)]
    g = logs[int(colour[1] * scale + half)]
    r = logs[int(colour[2] * scale + half)]
    middle = np.float32(C_BINS / 2) + half
    light = int(((b + g + r) / np.float32(3.0) - np.float32(_L_LEAST)) * np.float32(1.0 / L_STEP))
    red = int(_squeezed(r - g) * np.float32(1.0 / C_STEP) + middle)
    blue = int(_squeezed(b - g) * np.float32(1.0 / C_STEP) + middle)
    red = min(max(red, 0), C_BINS - 1)
    blue = min(max(blue, 0), C_BINS - 1)
    return (red * C_BINS + blue) * L_BINS + min(light, L_BINS - 1)


@compiled
def _log_densities(
    floor: NDArray[np.float32],
    shades: NDArray[np.float32],
    above: NDArray[np.float32],
    log_prior: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Fill `out`, one line of brightness after the other; most are empty."""
    full = np.log(np.float32(4.0 * _SUN_WEIGHT) * floor.max())
    nothing = np.float32(-28.0)
    for start in range(0, len(floor), L_BINS):
        end = start + L_BINS
        overexposed = end - _overexposed(start // L_BINS)
        prior = np.exp(log_prior[start])
        seen_above, seen_floor = above[start:end].max() > 0.0, shades[start:end].max() > 0.0
        for k in range(start, end):
            out[THING, k] = log_prior[k]
            out[WALL, k] = log_prior[k] + np.float32(_LOG_HALF)
            if seen_above:
                out[WALL, k] = np.log(np.float32(0.5) * (prior + above[k]))
            out[FLOOR, k] = log_prior[k] + np.float32(_LOG_RARE)
            out[SHADE, k] = nothing
            out[SUN, k] = nothing
            out[FULL, k] = full if k >= overexposed else nothing
        if not seen_floor:
            continue
        for k in range(start, end):
            core = floor[k]
            for step in range(1, min(_BRIGHTER_BINS, k - start) + 1):
                core = max(core, np.float32(0.5) * floor[k - step])
            shade, sun = np.float32(1e-11), np.float32(1e-11)
            for step in range(1, min(_LIGHT_BINS, end - 1 - k) + 1):
                shade = max(shade, shades[k + step])
            for step in range(1, min(_LIGHT_BINS, k - start) + 1):
                sun = max(sun, shades[k - step])
            out[FLOOR, k] = np.log(core + np.float32(1e-3) * prior)
            out[SHADE, k] = np.log(np.float32(_SHADE_WEIGHT) * shade)
            out[SUN, k] = np.log(np.float32(_SUN_WEIGHT) * sun)


@compiled
def _overexposed(ratios: int) -> int:
    """Return how many of the brightest bins of one pair of ratios have a channel that is full."""
    red = _ratio((ratios // C_BINS - C_BINS // 2) * C_STEP)
    blue = _ratio((ratios % C_BINS - C_BINS // 2) * C_STEP)
    # Of the channel with the largest logarithm, above the mean of the three.
    above = max(red, blue, 0.0) - (red + blue) / 3.0
    first = int((_FULL - above - _L_LEAST) / L_STEP)
    return L_BINS - min(max(first, 0), L_BINS)


@compiled
def _squeezed(ratio: np.float32) -> np.float32:
    """Return a log ratio that also separates strong colours in few bins."""
    return ratio / (np.float32(1.0) + abs(ratio))


@compiled
def _ratio(squeezed: float) -> float:
    """Return the log ratio that `_squeezed` took."""
    return squeezed / (1.0 - abs(squeezed))


@compiled
def _evidence(
    logs: NDArray[np.float32],
    bins: NDArray[np.int32],
    found: NDArray[np.float32],
) -> None:
    """Fill `found`, one row after the other."""
    n, columns = bins.shape
    offset = np.zeros(columns, np.int32)
    sums = np.zeros((3, columns + 1), np.float32)
    most = np.float32(_SURE)
    for i in range(n):
        for c in range(columns):
            base = bins[i, c] // L_BINS * L_BINS
            at = bins[i, c] - base - offset[c]
            for k in range(3):
                place = base + min(max(at + 1 - k, 0), L_BINS - 1)
                fit = logs[FLOOR, place] - logs[THING, place]
                sums[k, c + 1] = sums[k, c] + min(max(fit, -most), most)
        for c in range(columns):
            left, right = max(c - _DRIFT_HALF, 0), min(c + _DRIFT_HALF + 1, columns)
            least = np.float32(_DRIFT_GAIN * (right - left)) + sums[1, right] - sums[1, left]
            # The colour is looked up one bin up: the light is one bin darker.
            darker, brighter = sums[0, right] - sums[0, left], sums[2, right] - sums[2, left]
            if brighter > least and brighter >= darker:
                offset[c] = min(offset[c] + 1, _LIGHT_BINS)
            elif darker > least:
                offset[c] = max(offset[c] - 1, -_LIGHT_BINS)
            found[0, i, c] = _speaks(logs, THING, bins[i, c], offset[c])
            found[1, i, c] = _speaks(logs, WALL, bins[i, c], offset[c])


@compiled
def _speaks(logs: NDArray[np.float32], kind: int, seen: int, offset: int) -> float:
    """Return the evidence of one colour in light brighter by some bins."""
    base = seen // L_BINS * L_BINS
    shifted_back = base + min(max(seen - base - offset, 0), L_BINS - 1)
    obstacle, floor = logs[kind, seen], logs[FLOOR, shifted_back]
    value = float(min(max(obstacle - floor, -_SURE), _SURE))
    # An overexposed cell stays so in any light.
    shade, sun = logs[SHADE, shifted_back], max(logs[SUN, shifted_back], logs[FULL, seen])
    other = max(shade, sun)
    if value > SHADOWED and other > floor:
        value = min(value, float(obstacle - other))
        if value < 0.0:
            return SHADOWED if shade >= sun else LIT
    return value
