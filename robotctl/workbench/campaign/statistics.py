"""Summary of the results of a campaign: rates with intervals, distributions, and what matters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats  # type: ignore[import-untyped]

from robotctl.workbench.campaign.conditions import Condition, value_of
from robotctl.workbench.campaign.plan import CASE, SEED
from robotctl.workbench.campaign.results import Head, Result, Verdict

CONFIDENCE: Final = 0.95
SURE: Final = 0.05
"""An effect or a difference with a greater p may be chance."""
_FEW: Final = 6
"""Maximum number of values of a number that are shown one by one; more are a range."""
_FIELDS: Final = (
    "time_s",
    "time_by_best",
    "distance_m",
    "pose_error.rmse_m",
    "localisation.error.rmse_m",
    "min_clearance_m",
)
"""Fields whose distribution is shown, beside those of the criteria."""
_MORE_IS_BETTER: Final = frozenset((
    "min_clearance_m", "localisation.localised_share", "items_done", "map_quality.recall",
    "map_quality.precision", "mission_completed", "arrived",
))  # fmt: skip
NEITHER: Final = frozenset(("distance_m",))
"""Fields of which neither more nor less is better."""
_PARTS: Final = 4
"""Equal parts in which a range is shown."""


@dataclass(frozen=True, slots=True)
class Rate:
    """A share with its 95 % interval by Wilson (1927)."""

    count: int
    total: int

    @property
    def share(self) -> float:
        """The share; nan of none."""
        return self.count / self.total if self.total else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Its interval."""
        if not self.total:
            return 0.0, 1.0
        found = stats.binomtest(self.count, self.total).proportion_ci(CONFIDENCE, "wilson")
        return float(found.low), float(found.high)

    def __str__(self) -> str:
        """Return the rate for people."""
        if not self.total:
            return "none"
        low, high = self.interval
        return (
            f"{self.count} of {self.total}, {100 * self.share:.3g} % "
            f"(95 %: {100 * low:.3g} to {100 * high:.3g} %)"
        )


@dataclass(frozen=True, slots=True)
class Distribution:
    """Values of a field over all runs of a case that have it, in ascending order."""

    case: str
    field: str
    values: NDArray[np.float64]

    def quantile(self, share: float) -> float:
        """Return a quantile."""
        return float(np.quantile(self.values, share))


@dataclass(frozen=True, slots=True)
class Effect:
    """How something of the runs depends on a factor.

    Attributes
    ----------
    factor
        Name of the factor.
    of
        A field; empty: passing.
    levels
        Value of the factor, and there the rate of passing, or the median of the field.
    p
        Probability of such a difference, or a greater one, if the factor had no influence; adjusted
        for all effects that were looked for (Benjamini and Hochberg 1995).
    """

    factor: str
    of: str
    levels: tuple[tuple[str, str], ...]
    p: float


@dataclass(frozen=True, slots=True)
class Judged:
    """A result with the verdict on it."""

    result: Result
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Summary:
    """Everything that the page of a campaign shows.

    Attributes
    ----------
    head
        What the results are of.
    rate
        Rate of passing among runs with a result.
    case_rates
        The same for each name of a case.
    judged
        All results so far.
    distributions
        Distributions of the fields that the page shows.
    effects
        All effects that were looked for, the surest first.
    worst
        For each of these fields, the run with the worst value.
    """

    head: Head
    rate: Rate
    case_rates: Mapping[str, Rate]
    judged: tuple[Judged, ...]
    distributions: tuple[Distribution, ...]
    effects: tuple[Effect, ...]
    worst: tuple[tuple[str, Result], ...]

    @property
    def failures(self) -> tuple[Judged, ...]:
        """Runs that failed, those with most against them first."""
        failed = [each for each in self.judged if each.verdict.passed is False]
        return tuple(sorted(failed, key=lambda each: -len(each.verdict.why)))

    @property
    def without_result(self) -> tuple[Judged, ...]:
        """Runs without a result."""
        return tuple(each for each in self.judged if each.verdict.passed is None)


def summarise(head: Head, results: Iterable[Result]) -> Summary:
    """Return what results show."""
    judged = tuple(Judged(each, head.judge(each)) for each in results)
    counted = [each for each in judged if each.verdict.passed is not None]
    cases: dict[str, list[Judged]] = {}
    for each in counted:
        cases.setdefault(each.result.factors.get(CASE, ""), []).append(each)
    distributions = tuple(
        Distribution(case, field, np.sort([float(value) for _, value in found]))
        for case, members in cases.items()
        for field in shown_fields(head.conditions)
        if (found := [*_values(members, field)])
    )
    vary = {each.field: True for each in distributions if each.values[0] < each.values[-1]}
    return Summary(
        head,
        _rate(counted),
        {case: _rate(members) for case, members in cases.items() if case},
        judged,
        distributions,
        _effects(counted, [*dict.fromkeys(each.field for each in distributions)]),
        tuple((field, _worst(counted, field)) for field in vary if field not in NEITHER),
    )


def _rate(counted: Sequence[Judged]) -> Rate:
    """Return the rate of passing."""
    return Rate(sum(each.verdict.passed is True for each in counted), len(counted))


def shown_fields(conditions: Iterable[Condition]) -> tuple[str, ...]:
    """Return the fields of numbers that a page shows."""
    asked = [each.field for each in conditions if not isinstance(each.bound, bool | str)]
    return tuple(dict.fromkeys((*asked, *_FIELDS)))


def is_better(field: str, difference: float) -> bool:
    """Return whether a field that changes by a difference has become better."""
    return (difference > 0.0) == (field in _MORE_IS_BETTER)


def _values(judged: Iterable[Judged], field: str) -> Iterable[tuple[Judged, float]]:
    """Yield the runs whose report has a field, with its value."""
    for each in judged:
        value = value_of(each.result.report or {}, field)
        if isinstance(value, int | float):
            yield each, value


def _worst(judged: Iterable[Judged], field: str) -> Result:
    """Return the run with the worst value of a field."""
    sign = -1.0 if field in _MORE_IS_BETTER else 1.0
    return max(_values(judged, field), key=lambda found: sign * found[1])[0].result


def _effects(judged: Sequence[Judged], fields: Sequence[str]) -> tuple[Effect, ...]:
    """Return the effects of all factors that vary, on passing and on the fields."""
    names = dict.fromkeys(name for each in judged for name in each.result.factors)
    found = []
    for name in names:
        levels = [each.result.factors.get(name) for each in judged]
        count = len({*map(str, levels)})
        # Names with a run or two each, as missions drawn, tell nothing of the next.
        if name == SEED or count < 2 or (2 * count > len(levels) and not _is_range(levels)):
            continue
        found.append(
            _effect(name, "", [(each, float(bool(each.verdict.passed))) for each in judged])
        )
        found += [_effect(name, field, [*_values(judged, field)]) for field in fields]
    if not found:
        return ()
    adjusted = stats.false_discovery_control([each.p for each in found])
    together = (
        Effect(each.factor, each.of, each.levels, float(p))
        for each, p in zip(found, adjusted, strict=True)
    )
    return tuple(sorted(together, key=lambda each: each.p))


def _effect(factor: str, of: str, found: Sequence[tuple[Judged, float]]) -> Effect:
    """Return how values depend on a factor; p not yet adjusted."""
    levels = [each.result.factors.get(factor) for each, _ in found]
    values = np.array([value for _, value in found], dtype=float)
    if _is_range(levels):
        numbers = np.array(levels, dtype=float)
        p = _p_of_range(numbers, values)
        groups = _groups_of_range(numbers, values)
    else:
        names = [_name(each) for each in levels]
        groups = {name: values[[each == name for each in names]] for name in dict.fromkeys(names)}
        p = _p_of_groups([*groups.values()], is_rate=not of)
    return Effect(factor, of, tuple((k, _shown(v, is_rate=not of)) for k, v in groups.items()), p)


def _is_range(levels: Sequence[Any]) -> bool:
    """Whether values of a factor are numbers, and many."""
    numbers = all(isinstance(each, int | float) and not isinstance(each, bool) for each in levels)
    return numbers and len(set(levels)) > _FEW


def _name(level: Any) -> str:
    """Return a value of a factor for people."""
    return "none" if level == "" else str(level).lower() if isinstance(level, bool) else str(level)


def _shown(values: NDArray[np.float64], *, is_rate: bool) -> str:
    """Return what a group of runs shows."""
    if is_rate:
        return f"{int(values.sum())}/{len(values)}"
    return f"{np.median(values):.3g}"


def _p_of_range(numbers: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return the p-value of Spearman's rank correlation; 1 without any variation."""
    if np.ptp(numbers) == 0.0 or np.ptp(values) == 0.0:
        return 1.0
    return float(stats.spearmanr(numbers, values).pvalue)


def _groups_of_range(
    numbers: NDArray[np.float64], values: NDArray[np.float64]
) -> Mapping[str, NDArray[np.float64]]:
    """Return the values in equal parts of a range, by name."""
    edges = np.linspace(numbers.min(), numbers.max(), _PARTS + 1)
    part = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, _PARTS - 1)
    return {
        f"{edges[index]:.3g}..{edges[index + 1]:.3g}": values[part == index]
        for index in range(_PARTS)
        if np.any(part == index)
    }


def _p_of_groups(groups: Sequence[NDArray[np.float64]], *, is_rate: bool) -> float:
    """Return the p-value of a difference between groups.

    Of rates by Fisher's exact test, of more than two by Pearson's; of values by Kruskal and Wallis.
    """
    together = np.concatenate(groups) if groups else np.zeros(1)
    if len(groups) < 2 or np.ptp(together) == 0.0:
        return 1.0
    if not is_rate:
        return float(stats.kruskal(*groups).pvalue)
    table = [[int(each.sum()), int(len(each) - each.sum())] for each in groups]
    if len(groups) == 2:
        return float(stats.fisher_exact(table).pvalue)
    return float(stats.chi2_contingency(table).pvalue)
