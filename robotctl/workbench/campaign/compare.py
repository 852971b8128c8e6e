"""Two folders of results, run by run: better, worse, or no difference that is not chance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats  # type: ignore[import-untyped]

from robotctl.errors import ConfigError
from robotctl.workbench.campaign.conditions import value_of
from robotctl.workbench.campaign.plan import SEED
from robotctl.workbench.campaign.results import Head, Result
from robotctl.workbench.campaign.statistics import (
    CONFIDENCE,
    NEITHER,
    SURE,
    is_better,
    shown_fields,
)

PASSING: Final = "passing"
BETTER, WORSE, CHANGED, SAME = "better", "worse", "changed", "no difference"
_RESAMPLES: Final = 9999


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of a field, or of passing, between runs of the same kind and seed.

    Attributes
    ----------
    field
        Its name.
    pairs, more, less
        Number of pairs of runs, and in how many the second has more or less than the first.
    before, after
        Mean of the first and of the second runs.
    interval
        95 % interval of the mean difference, by bootstrap of the pairs (Efron 1979).
    p
        Probability of as uneven a count of more and less by chance: the exact sign test, for
        passing that of McNemar (1947); adjusted for all fields in which a pair differs (Benjamini
        and Hochberg 1995).
    """

    field: str
    pairs: int
    more: int
    less: int
    before: float
    after: float
    interval: tuple[float, float]
    p: float

    @property
    def verdict(self) -> str:
        """Whether the second is better."""
        if self.p >= SURE:
            return SAME
        if self.field in NEITHER:
            return CHANGED
        more_is_better = self.field == PASSING or is_better(self.field, 1.0)
        return BETTER if (self.more > self.less) == more_is_better else WORSE


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of two folders of results.

    Attributes
    ----------
    differences
        Difference of passing, then of each field that is shown.
    unpaired
        Results that have none of the same kind and seed in the other folder.
    broken
        Runs of the second folder that fail, where those of the first pass.
    """

    differences: tuple[Difference, ...]
    unpaired: int
    broken: tuple[Result, ...]


def compare(
    first: tuple[Head, Sequence[Result]], second: tuple[Head, Sequence[Result]]
) -> Comparison:
    """Compare two folders as `read_folder` returns them, by the criteria of the second.

    What has one value throughout each folder, as a gain that was changed, does not tell runs apart.

    Raises
    ------
    ConfigError
        If no run of one folder has its like in the other, or has more than one.
    """
    names = _telling(first[1]) | _telling(second[1]) | {SEED}
    before, after = (_by_kind(head, found, names) for head, found in (first, second))
    pairs = [(before[key], after[key]) for key in after if key in before]
    if not pairs:
        raise ConfigError(
            f"{first[0].name} and {second[0].name}: no run of one has its like in the other; "
            f"runs are told apart by {', '.join(sorted(names))}"
        )
    verdicts = [tuple(second[0].judge(each).passed for each in pair) for pair in pairs]
    passed = [each for each in verdicts if None not in each]
    found = [_difference(PASSING, np.array(passed, dtype=float).reshape(-1, 2))]
    for field in shown_fields(second[0].conditions):
        values = np.array([*_both(pairs, field)], dtype=float).reshape(-1, 2)
        if len(values):
            found.append(_difference(field, values))
    return Comparison(
        _adjusted(found),
        len(before) + len(after) - 2 * len(pairs),
        tuple(
            pair[1]
            for pair, verdict in zip(pairs, verdicts, strict=True)
            if verdict == (True, False)
        ),
    )


def _adjusted(found: Sequence[Difference]) -> tuple[Difference, ...]:
    """Return differences with p adjusted for all fields in which any pair differs."""
    changed = [each for each in found if each.more + each.less]
    p = stats.false_discovery_control([each.p for each in changed]) if changed else []
    adjusted = dict(zip([each.field for each in changed], map(float, p), strict=True))
    return tuple(replace(each, p=adjusted.get(each.field, 1.0)) for each in found)


def _both(pairs: Iterable[tuple[Result, Result]], field: str) -> Iterator[tuple[float, ...]]:
    """Yield a field of pairs whose reports both have it."""
    for pair in pairs:
        values = tuple(value_of(each.report or {}, field) for each in pair)
        if all(isinstance(each, int | float) for each in values):
            yield values


def _difference(field: str, values: NDArray[np.float64]) -> Difference:
    """Return the difference of a field; `values` (n, 2): before and after."""
    differences = values[:, 1] - values[:, 0]
    more, less = int(np.sum(differences > 0.0)), int(np.sum(differences < 0.0))
    p = float(stats.binomtest(more, more + less).pvalue) if more + less else 1.0
    before, after = values.mean(axis=0) if len(values) else (float("nan"), float("nan"))
    return Difference(
        field, len(values), more, less, float(before), float(after), _interval(differences), p
    )


def _interval(differences: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % interval of a mean."""
    if len(differences) < 2 or np.ptp(differences) == 0.0:
        mean = float(differences.mean()) if len(differences) else float("nan")
        return mean, mean
    found = stats.bootstrap(
        (differences,),
        np.mean,
        n_resamples=_RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(found.low), float(found.high)


def _telling(results: Sequence[Result]) -> set[str]:
    """Return the factors that tell the runs of a folder apart."""
    names = {name for each in results for name in each.factors}
    return {name for name in names if len({str(each.factors.get(name)) for each in results}) > 1}


def _by_kind(head: Head, results: Sequence[Result], names: set[str]) -> dict[str, Result]:
    """Return results by the values of some factors."""
    found: dict[str, Result] = {}
    for each in results:
        key = str(sorted((name, str(each.factors.get(name))) for name in names))
        if key in found:
            raise ConfigError(
                f"{head.name}: runs {found[key].number} and {each.number} differ in nothing that "
                "the other folder knows"
            )
        found[key] = each
    return found
