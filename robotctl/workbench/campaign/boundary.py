"""Points where passes turn into failures, of which later ones are put where earlier ones failed.

A Gaussian process of the share of runs that pass estimates the border, where half of them do; the
next points are those that straddle it, by a weighted `sigma - |mu|` (Bryan et al., Active learning
for identifying function threshold boundaries, NIPS 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve  # type: ignore[import-untyped]

from robotctl.workbench.campaign.campaign_file import BATCH, BOUNDARY, Campaign
from robotctl.workbench.campaign.plan import Run, plan, runs_at, unit_points, values_at

Floats = NDArray[np.float64]

_CANDIDATES: Final = 1000
_LENGTHS: Final = (0.1, 0.2, 0.4, 0.8)
"""Length scales that are tried, in sides of the unit cube."""
_WIDTH: Final = 1.5
"""Standard deviations within which a point may be on the border; with more, it explores more."""
_NOISE: Final = 0.1
"""Variance of the outcome at one point, which is -1 or 1: seeds differ."""


def batches(campaign: Campaign, passes: Callable[[Run], bool | None]) -> Iterator[Sequence[Run]]:
    """Yield the runs of a campaign in batches, the next when all of one have been driven.

    Parameters
    ----------
    campaign
        One whose sample is not a search has one batch.
    passes
        Whether a run of an earlier batch passes; None: it has no result, and decides nothing.
    """
    sample, ranges = campaign.sample, campaign.ranges()
    yield (runs := plan(campaign))
    if sample is None or sample.method != BOUNDARY:
        return
    known, first = unit_points(len(ranges), sample), 1
    shares: list[float] = []
    while True:
        count = len(known) - len(shares)
        # Points vary fastest within the runs of a batch.
        shares += [_share([passes(run) for run in runs[index::count]]) for index in range(count)]
        first += len(runs)
        count = min(BATCH, sample.points - len(known))
        if not count:
            return
        rng = np.random.default_rng([sample.seed, len(known)])
        points = straddling(known, np.array(shares), count, rng)
        known = np.vstack([known, points])
        yield (runs := runs_at(campaign, values_at(ranges, points), first))


def _share(passed: Sequence[bool | None]) -> float:
    """Return the share of runs that pass, of those with a result; nan of none."""
    found = [each for each in passed if each is not None]
    return sum(found) / len(found) if found else float("nan")


def straddling(known: Floats, shares: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Return points of the unit cube near the border, (count, dimensions).

    Parameters
    ----------
    known
        Points that are known, (n, dimensions).
    shares
        Share that passes at each; nan: unknown.
    count
        How many.
    rng
        Draws the candidates.
    """
    candidates = rng.random((_CANDIDATES, known.shape[1]))
    is_known = np.isfinite(shares)
    x, y = known[is_known], 2.0 * shares[is_known] - 1.0
    length = max(_LENGTHS, key=lambda each: _evidence(x, y, each)) if len(x) else _LENGTHS[-1]
    across = _kernel(candidates, x, length)
    factor = cho_factor(_kernel(x, x, length) + _NOISE * np.eye(len(x))) if len(x) else None
    mean = across @ cho_solve(factor, y) if factor else np.zeros(len(candidates))
    covariance = _kernel(candidates, candidates, length)
    if factor:
        covariance -= across @ cho_solve(factor, across.T)
    chosen: list[int] = []
    for _ in range(count):
        score = _WIDTH * np.sqrt(np.maximum(np.diag(covariance), 0.0)) - np.abs(mean)
        score[chosen] = -np.inf
        best = int(np.argmax(score))
        chosen.append(best)
        # As if it had the outcome that is expected there: the next one goes elsewhere.
        column = covariance[:, best].copy()
        covariance -= np.outer(column, column) / (column[best] + _NOISE)
    return candidates[chosen]


def _kernel(a: Floats, b: Floats, length: float) -> Floats:
    """Return the squared exponential covariance of the outcomes at points."""
    squared = np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=2)
    return np.asarray(np.exp(-0.5 * squared / length**2))


def _evidence(x: Floats, y: Floats, length: float) -> float:
    """Return the logarithm of the marginal likelihood, without its constant."""
    lower, _ = factor = cho_factor(_kernel(x, x, length) + _NOISE * np.eye(len(x)), lower=True)
    return float(-0.5 * y @ cho_solve(factor, y) - np.log(np.diag(lower)).sum())
