"""Time of the parts of a step that recurs, over the last seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from robotctl.messages.control import StepBudget

PLAN, STEER = "plan", "steer"
"""Parts: the first may take longer than a period, the second can do with less work."""

_KEPT = 200
"""Steps that count, the last ones: ten seconds of navigation."""

_WINDOW = 20
"""Steps that steer between two choices of the effort."""

_CROWDED, _EASY = 0.8, 0.35
"""Shares of the period: a step above is crowded, one below would bear twice the work."""

_MOST_CROWDED, _MOST_UNEASY = 0.1, 0.05
"""Shares of steps: from the first on that are crowded the effort is halved, up to the second that
are not easy it is doubled."""

_LEAST = 0.125
"""Least effort."""


class StepTimer:
    """Divides each step among its parts, and saves effort where steps that steer take too long.

    Planning does not count, since plans are cut into slices of their own.

    Parameters
    ----------
    period_ns
        Period of the steps [ns].
    now_ns
        Clock that never stands still [ns].

    Attributes
    ----------
    effort
        Share of its samples by which to steer, in (0, 1]: halved after a second with crowded steps,
        doubled after ten easy ones.
    """

    def __init__(self, period_ns: int, now_ns: Callable[[], int]) -> None:
        self._period_ns, self._now_ns = period_ns, now_ns
        self._steps = self._late = 0
        self._last_ns = now_ns()
        self._step: dict[str, int] = {}
        self.effort = 1.0
        self._since = 0
        """Steps that steered at the present effort."""
        self._kept: deque[dict[str, int]] = deque(maxlen=_KEPT)

    def begin(self) -> None:
        """Begin a step now."""
        self._last_ns, self._step = self._now_ns(), {}

    def lap(self, part: str) -> None:
        """Note that a part is over: it took the time since the last lap."""
        now_ns = self._now_ns()
        self._step[part] = self._step.get(part, 0) + now_ns - self._last_ns
        self._last_ns = now_ns

    def end(self) -> None:
        """End the step with what the laps have named."""
        self._steps += 1
        self._late += sum(self._step.values()) > self._period_ns
        self._kept.append(self._step)
        if STEER in self._step:
            self._since += 1
            if self._since % _WINDOW == 0:
                self._adapt()

    def _adapt(self) -> None:
        """Choose the effort by the last steps."""
        shares = [
            (sum(step.values()) - step.get(PLAN, 0)) / self._period_ns
            for step in self._kept
            if STEER in step
        ]
        crowded = sum(share > _CROWDED for share in shares[-_WINDOW:])
        if crowded >= _MOST_CROWDED * _WINDOW and self.effort > _LEAST:
            self.effort, self._since = self.effort / 2, 0
            return
        uneasy = sum(share > _EASY for share in shares)
        if self.effort < 1.0 and self._since >= _KEPT and uneasy <= _MOST_UNEASY * len(shares):
            self.effort, self._since = self.effort * 2, 0

    def budget(self) -> StepBudget:
        """Return the times over the last steps."""
        parts = dict.fromkeys(part for step in self._kept for part in step)
        in_all = [sum(step.values()) for step in self._kept]
        p50_ms, p99_ms = _percentiles_ms(in_all)
        by_part = {
            each: _percentiles_ms(step.get(each, 0) for step in self._kept) for each in parts
        }
        return StepBudget(
            period_ms=self._period_ns / 1e6,
            steps=self._steps,
            late=self._late,
            p50_ms=p50_ms,
            p99_ms=p99_ms,
            parts_p50_ms={part: p50 for part, (p50, _) in by_part.items()},
            parts_p99_ms={part: p99 for part, (_, p99) in by_part.items()},
            effort=self.effort,
        )


def _percentiles_ms(times_ns: Iterable[int]) -> tuple[float, float]:
    """Return the median and the 99th percentile [ms]: the values that so many do not exceed."""
    ordered = sorted(times_ns)
    if not ordered:
        return 0.0, 0.0
    p50, p99 = (ordered[-(-len(ordered) * percent // 100) - 1] for percent in (50, 99))
    return round(p50 / 1e6, 2), round(p99 / 1e6, 2)
