"""Long work in slices, so that a robot that searches its whole map goes on listening.

A slice weighs a bounded number of poses; a tracked robot's measurement is one or two of them, a
search of the map some dozens. The work is the same however it is interrupted.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.ranging.log_likelihood import LogLikelihood, evaluated

Result = TypeVar("Result")
Sliced: TypeAlias = Generator[int, None, Result]
"""Work that stops after each slice to say how many poses were weighed in it."""

SLICE: Final = 5000
"""Poses in a slice."""


def at_once(work: Sliced[Result]) -> Result:
    """Do all of it and return its result."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            result: Result = end.value
            return result


class Work:
    """A measurement that is weighed a bounded number of poses at a time."""

    def __init__(self) -> None:
        self._under_way: Sliced[None] | None = None

    @property
    def is_under_way(self) -> bool:
        """Whether some is left to do."""
        return self._under_way is not None

    def begin(self, work: Sliced[None], poses: int) -> int:
        """Begin with another one, as `go_on`; the one before must be done."""
        self._under_way = work
        return self.go_on(poses)

    def go_on(self, poses: int) -> int:
        """Weigh so many poses, or one slice more; return how many are left when it is done."""
        while self._under_way is not None and poses > 0:
            weighed = next(self._under_way, None)
            if weighed is None:
                self._under_way = None
            else:
                poses -= weighed
        return poses


def evaluated_in_slices(
    log_likelihood: LogLikelihood, poses: NDArray[np.float64], measurements: int = 1
) -> Sliced[NDArray[np.float64]]:
    """Return the log-likelihoods of poses, (n,), sums of so many measurements; see `evaluated`."""
    logs = np.empty(len(poses))
    size = max(SLICE // measurements, 1)
    for begin in range(0, len(poses), size):
        part = poses[begin : begin + size]
        logs[begin : begin + size] = evaluated(log_likelihood, part)
        yield len(part) * measurements
    return logs
