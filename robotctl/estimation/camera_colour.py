"""How the floor looks: densities of colour, learned from the free patch.

A colour is log brightness and two log ratios of its channels. A lamp that is nearer, a shadow or
another exposure moves all channels alike, also behind the camera's gamma, so it moves the
brightness and leaves the ratios. Densities are histograms, so tiles of two colours are no special case
(Ulrich and Nourbakhsh 2000, "Appearance-based obstacle detection with monocular color vision",
learn them from the area before the robot). What is seen above the horizon cannot be floor: its
colours speak for an obstacle.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.compiled import compiled

# One bin of brightness and of each ratio, and how many.
L_STEP: Final = 0.07
C_STEP: Final = 0.02
L_BINS: Final = 52
C_BINS: Final = 48
_DARK_OFFSET: Final = 6.0
"""Added to a channel of 0 to 255 before its logarithm: dark pixels are mostly noise."""
_PER_LEVEL: Final = 4
"""Logarithms are looked up in steps of this fraction of a level of 255."""

SHADOWED: Final = -0.25
"""Evidence of what is floor if it lies in a shadow."""
_SURE: Final = 3.0
"""Evidence stays within this and its negative, natural logarithms of odds."""
_SHADOW_BINS: Final = 10
"""A shadow darkens by so much at most: to half of the stored value, a fifth of the light."""
_LIT_BINS: Final = 2
"""Floor may be so much brighter than any of the patch."""


def _logarithms() -> NDArray[np.float32]:
    """Return log(level + offset) for levels of 0 to 255 in steps."""
    return np.log(np.arange(_PER_LEVEL * 255 + 1) / _PER_LEVEL + _DARK_OFFSET).astype(np.float32)


_LOGS: Final = _logarithms()
_L_LEAST: Final = float(_LOGS[0])
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
        So many columns to either side are averaged as well, (n,).

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
    """Return the shares of the same colours, brighter by so many bins."""
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


def evidence(
    floor: NDArray[np.float32], above: NDArray[np.float32], prior: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return for each bin how much a colour speaks for an obstacle.

    Parameters
    ----------
    floor, above
        Densities of the floor and of what is seen above the horizon, (bins,).
    prior
        Density of obstacles' colours before anything is seen.

    Returns
    -------
    ndarray
        log(p(colour | obstacle) / p(colour | floor)), (bins,), within 3; floor that may lie in a
        shadow is exactly `SHADOWED`.
    """
    # Dark pixels are noisy, and what light is left may have another colour.
    shades = cv2.blur(floor.reshape(_SHAPE), (3, 3), borderType=cv2.BORDER_REPLICATE).reshape(-1)
    table = np.empty(len(floor), np.float32)
    _evidence(floor, np.asarray(shades, np.float32), above, prior, table)
    return table


def obstacle_prior() -> NDArray[np.float32]:
    """Return the density of obstacles' colours: any brightness, rather grey than not."""
    ratio = (np.arange(C_BINS) - C_BINS // 2) * C_STEP
    one = 0.5 * np.exp(-0.5 * (ratio / 0.15) ** 2) + 0.1
    cube = np.repeat((one[:, None] * one)[:, :, None], L_BINS, axis=2)
    return np.asarray(cube / cube.sum(), np.float32).reshape(-1)


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
    red = int((r - g) * np.float32(1.0 / C_STEP) + middle)
    blue = int((b - g) * np.float32(1.0 / C_STEP) + middle)
    red = min(max(red, 0), C_BINS - 1)
    blue = min(max(blue, 0), C_BINS - 1)
    return (red * C_BINS + blue) * L_BINS + min(light, L_BINS - 1)


@compiled
def _evidence(
    floor: NDArray[np.float32],
    shades: NDArray[np.float32],
    above: NDArray[np.float32],
    prior: NDArray[np.float32],
    table: NDArray[np.float32],
) -> None:
    """Fill `table`, one line of brightness after the other."""
    low, high = np.float32(-_SURE), np.float32(_SURE)
    for start in range(0, len(floor), L_BINS):
        for light in range(L_BINS):
            k = start + light
            core = floor[k]
            for step in range(1, _LIT_BINS + 1):
                if light >= step:
                    core = max(core, np.float32(0.5) * floor[k - step])
            shade = np.float32(0.0)
            for step in range(1, min(_SHADOW_BINS, L_BINS - 1 - light) + 1):
                shade = max(shade, shades[k + step])
            shade *= np.float32(0.1)
            obstacle = np.float32(0.7) * prior[k] + np.float32(0.3) * above[k]
            value = np.log(obstacle / (core + np.float32(1e-3) * prior[k]))
            value = min(max(value, low), high)
            if value > np.float32(SHADOWED) and shade > obstacle:
                value = np.float32(SHADOWED)
            table[k] = value
