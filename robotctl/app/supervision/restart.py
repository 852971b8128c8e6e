"""Restarts of a process that ended: back-off and crash budget."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """Exponential back-off within a crash budget.

    Parameters
    ----------
    crashes
        Maximum ends within the window that are followed by a restart, at least 1.
    window_s
        Age beyond which ends are forgotten [s].
    first_delay_s
        Pause before the first restart [s]; it doubles with each end in the window.
    longest_delay_s
        Maximum pause [s].
    """

    crashes: int
    window_s: float = 60.0
    first_delay_s: float = 0.25
    longest_delay_s: float = 4.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.crashes < 1:
            raise ValueError(f"crashes must be at least 1, not {self.crashes}")
        if not 0.0 < self.first_delay_s <= self.longest_delay_s < self.window_s:
            raise ValueError(
                "the delays must be positive, rising and shorter than the window, not "
                f"{self.first_delay_s}, {self.longest_delay_s} and {self.window_s} s"
            )


class CrashBudget:
    """Counts the ends of one process.

    Parameters
    ----------
    policy
        Back-off and budget.
    """

    def __init__(self, policy: RestartPolicy) -> None:
        self._policy = policy
        self._ends_s: deque[float] = deque()

    def spend(self, now_s: float) -> float | None:
        """Note an end at `now_s`, monotonic [s].

        Returns
        -------
        float | None
            Pause before the restart [s]; None if the budget is spent.
        """
        policy, ends_s = self._policy, self._ends_s
        while ends_s and now_s - ends_s[0] > policy.window_s:
            ends_s.popleft()
        ends_s.append(now_s)
        if len(ends_s) > policy.crashes:
            return None
        delay_s = policy.first_delay_s * 2.0 ** (len(ends_s) - 1)
        return min(delay_s, policy.longest_delay_s)
