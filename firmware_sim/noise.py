"""Random numbers of the compiled functions: a stream each, which they can draw from."""

from __future__ import annotations

import numpy as np

from native_kernels.compiled import borrows, compiled


def noise_state(rng: np.random.Generator) -> np.ndarray:
    """State of a fresh stream of `uniform` and `normal`, seeded from a generator."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@compiled
@borrows
def uniform(state: np.ndarray) -> float:
    """Next number in [0, 1) of the stream (SplitMix64: Steele, Lea and Flood, OOPSLA 2014)."""
    z = state[0] + np.uint64(0x9E3779B97F4A7C15)
    state[0] = z
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(np.float64(z >> np.uint64(11)) * 1.1102230246251565e-16)


@compiled
@borrows
def normal(state: np.ndarray) -> float:
    """Next standard normal number of the stream (Box and Muller)."""
    radius = np.sqrt(-2.0 * np.log(1.0 - uniform(state)))
    return float(radius * np.cos(2.0 * np.pi * uniform(state)))
