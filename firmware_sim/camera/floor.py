"""Floors and other textures: patterns that repeat every `PERIOD_M`, with coarser copies (mipmaps).

A pattern is drawn once from a seed, in metres. Each coarser copy averages two by two texels of the
one before, so that distant floor is neither sharper nor noisier than through a lens.

A floor is laid in pieces (tiles, planks), each cut out of the pattern at a place of its own. So it
does not repeat with the pattern, and a camera can distinguish its places.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

SIDE: Final = 1024
PERIOD_M: Final = 2.4
TEXEL_M = PERIOD_M / SIDE
LEVELS: Final = 9
"""Number of copies; the coarsest has 4 by 4 texels."""
PIECES: Final = 256
"""Pieces along x and along y after which a floor repeats."""


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A pattern and its coarser copies.

    Attributes
    ----------
    texels
        All copies, finest first, row by row, (n,) uint32: blue, green and red from the lowest byte
        on. Row j, column i of the finest is the square of `TEXEL_M` about x = (i + 0.5),
        y = (j + 0.5) texels.
    starts
        Index of the first texel of each copy, (LEVELS,).
    """

    texels: np.ndarray
    starts: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Laying:
    """How the pieces of a floor lie.

    Attributes
    ----------
    size
        Size of a piece along x and y [m], (2,).
    shift
        Offset of the pieces of each row before a multiple of their size, (PIECES,) [m].
    cut
        Place in the pattern of the corner of least x, y of each piece, (PIECES, PIECES, 2) [m], by
        row, then piece in the row.
    """

    size: np.ndarray
    shift: np.ndarray
    cut: np.ndarray


@lru_cache(maxsize=8)
def floor_laying(name: str, seed: int) -> Laying:
    """Draw the laying of a floor with a pattern."""
    rng = np.random.default_rng([seed, 5])
    size, step = (np.array(each) for each in _PIECES_M[name])
    steps = np.rint(PERIOD_M / step).astype(int)
    shift = size[0] * rng.random(PIECES) if name == "wood" else np.zeros(PIECES)
    return Laying(size, shift, step * rng.integers(0, steps, (PIECES, PIECES, 2)))


@lru_cache(maxsize=8)
def print_texture(seed: int) -> Texture:
    """Draw the texture that prints are cut from: overlapping rectangles, channel by channel."""
    rng = np.random.default_rng([seed, 6])
    picture = np.full((SIDE, SIDE, 3), 128.0)
    for most_m, count in ((0.3, 300), (0.12, 1200), (0.05, 3000)):
        low = rng.integers(0, SIDE, (count, 2))
        high = low + 2 + rng.integers(0, round(most_m / TEXEL_M), (count, 2))
        channels, values = rng.integers(0, 3, count), rng.uniform(20.0, 235.0, count)
        for (j, i), (to_j, to_i), channel, value in zip(low, high, channels, values, strict=True):
            picture[j:to_j, i:to_i, channel] = value
    return _with_copies(picture)


@lru_cache(maxsize=8)
def floor_texture(name: str, seed: int) -> Texture:
    """Draw the pattern of a floor: `tiles`, `wood`, `carpet` or `concrete`."""
    rng = np.random.default_rng([seed, 1])
    return _with_copies(_PATTERNS[name](rng))


@lru_cache(maxsize=8)
def plaster_texture(seed: int) -> Texture:
    """Draw the grain of walls and furniture: grey, 128 in the mean."""
    rng = np.random.default_rng([seed, 2])
    grain = 4.0 * _noise(rng, 0.006) + 1.5 * _noise(rng, 0.08) + 1.0 * _noise(rng, 0.4)
    return _with_copies(np.repeat(128.0 + grain[..., None], 3, axis=2))


def _with_copies(picture: np.ndarray) -> Texture:
    copies, starts, count = [], [], 0
    for _ in range(LEVELS):
        starts.append(count)
        copies.append(np.clip(np.rint(picture), 0, 255).astype(np.uint32).reshape(-1, 3))
        count += len(copies[-1])
        n = len(picture) // 2
        picture = picture.reshape(n, 2, n, 2, 3).mean(axis=(1, 3))
    texels = np.vstack(copies) @ np.array([1, 1 << 8, 1 << 16], dtype=np.uint32)
    return Texture(texels, np.array(starts, dtype=np.int64))


def _noise(rng: np.random.Generator, length_m: float, stretch: float = 1.0) -> np.ndarray:
    """Draw periodic Gaussian noise, (SIDE, SIDE), standard deviation 1, correlated over a length.

    `stretch` lengthens it along x.
    """
    frequency = np.fft.fftfreq(SIDE, TEXEL_M)
    x, y = np.meshgrid(frequency[: SIDE // 2 + 1] * stretch, frequency)
    low = np.exp(-0.5 * (2.0 * np.pi * length_m / 2.0) ** 2 * (x * x + y * y))
    low[0, 0] = 0.0
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((SIDE, SIDE))) * low, s=(SIDE, SIDE))
    result: np.ndarray = field / field.std()
    return result


def _metres() -> tuple[np.ndarray, np.ndarray]:
    """Middle of each texel, x along columns, y along rows, (SIDE, SIDE) [m]."""
    at = (np.arange(SIDE) + 0.5) * TEXEL_M
    x, y = np.meshgrid(at, at)
    return x, y


def _coloured(bgr: tuple[float, float, float], grey: np.ndarray) -> np.ndarray:
    picture: np.ndarray = np.array(bgr) * (1.0 + grey[..., None])
    return picture


def _tiles(rng: np.random.Generator) -> np.ndarray:
    """Stone tiles of 0.3 m with joints of 6 mm."""
    x, y = _metres()
    size, joint = 0.3, 0.006
    n = round(PERIOD_M / size)
    tone = 0.05 * rng.standard_normal((n, n))
    number = (np.floor(y / size).astype(int), np.floor(x / size).astype(int))
    grey = tone[number] + 0.04 * _noise(rng, 0.005) + 0.03 * _noise(rng, 0.12)
    picture = _coloured((150.0, 165.0, 175.0), grey)
    in_joint = (np.mod(x + joint / 2, size) < joint) | (np.mod(y + joint / 2, size) < joint)
    picture[in_joint] = _coloured((88.0, 92.0, 98.0), 0.05 * _noise(rng, 0.01))[in_joint]
    return picture


def _wood(rng: np.random.Generator) -> np.ndarray:
    """Planks of 0.12 m by 1.2 m along x."""
    x, y = _metres()
    width, length = 0.12, 1.2
    rows, columns = round(PERIOD_M / width), round(PERIOD_M / length)
    row = np.floor(y / width).astype(int)
    column = np.floor(x / length).astype(int)
    tone = 0.10 * rng.standard_normal((rows, columns))[row, column]
    grey = tone + 0.06 * _noise(rng, 0.006, 20.0) + 0.04 * _noise(rng, 0.03, 10.0)
    gap = (np.mod(y, width) < 0.002) | (np.mod(x, length) < 0.003)
    return _coloured((80.0, 125.0, 170.0), np.where(gap, -0.55, grey))


def _carpet(rng: np.random.Generator) -> np.ndarray:
    """Pile with specks of two colours."""
    grey = 0.10 * _noise(rng, 0.004) + 0.05 * _noise(rng, 0.02) + 0.04 * _noise(rng, 0.3)
    picture = _coloured((110.0, 95.0, 85.0), grey)
    for colour in ((150.0, 120.0, 95.0), (70.0, 75.0, 105.0)):
        picture[_noise(rng, 0.008) > 1.6] = colour
    return picture


def _concrete(rng: np.random.Generator) -> np.ndarray:
    """Grey with blotches and pores."""
    grey = 0.03 * _noise(rng, 0.005) + 0.05 * _noise(rng, 0.06) + 0.06 * _noise(rng, 0.5)
    picture = _coloured((140.0, 143.0, 145.0), grey)
    picture[_noise(rng, 0.01) > 3.0] *= 0.6
    return picture


_PATTERNS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "tiles": _tiles,
    "wood": _wood,
    "carpet": _carpet,
    "concrete": _concrete,
}
_PIECES_M: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "tiles": ((0.3, 0.3), (0.3, 0.3)),
    "wood": ((1.2, 0.12), (1.2, 0.12)),
    "carpet": ((0.6, 0.6), (TEXEL_M, TEXEL_M)),
    "concrete": ((1.2, 1.2), (TEXEL_M, TEXEL_M)),
}
"""Size of a piece along x and y, and the grid on which it is cut, that of the pattern's joints."""
