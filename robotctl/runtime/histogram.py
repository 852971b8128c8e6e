"""A histogram of durations with a fixed memory and a constant relative error."""

from __future__ import annotations

from bisect import bisect_left
from itertools import accumulate

_SUB_BITS = 5
_SUB = 1 << _SUB_BITS
_OCTAVES = 24
_TOO_GREAT = 1 << (_SUB_BITS + _OCTAVES - 1)


class Histogram:
    """Counts of non-negative integers in log-linear buckets, 32 to each power of two.

    A percentile is therefore accurate to 1/32 of its value (the idea of Tene's HdrHistogram);
    adding costs two list accesses, which a 1 kHz loop can afford on every tick. Values from 2^28 on
    share the last bucket; `maximum` is exact.
    """

    def __init__(self) -> None:
        self._counts = [0] * (_SUB * _OCTAVES)
        self.total = 0
        self.maximum = 0

    def add(self, value: int) -> None:
        """Count `value`; negative values count as 0."""
        if value < _SUB:
            index = max(value, 0)
        elif value < _TOO_GREAT:
            shift = value.bit_length() - 1 - _SUB_BITS
            index = ((shift + 1) << _SUB_BITS) + (value >> shift) - _SUB
        else:
            index = _SUB * _OCTAVES - 1
        self._counts[index] += 1
        self.total += 1
        if value > self.maximum:  # noqa: PLR1730 - max() takes four times as long
            self.maximum = value

    def percentiles(self, *shares: float) -> tuple[int, ...]:
        """Return, for each share [0, 1], the upper bound of the bucket that holds that quantile.

        0 if nothing was counted. About 10 us.
        """
        if not self.total:
            return (0,) * len(shares)
        sums = list(accumulate(self._counts))
        return tuple(
            min(_upper_bound(bisect_left(sums, max(share * self.total, 1))), self.maximum)
            for share in shares
        )


def _upper_bound(index: int) -> int:
    """Return the maximum value of a bucket."""
    octave, sub = divmod(index, _SUB)
    if octave == 0:
        return sub
    return ((sub + _SUB + 1) << (octave - 1)) - 1
