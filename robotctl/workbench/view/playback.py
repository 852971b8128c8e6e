"""The time that is shown of one run, or of several beside each other."""

from __future__ import annotations

from collections.abc import Sequence


class PlaybackClock:
    """Time of a replay, which stands or goes.

    Parameters
    ----------
    lengths_ns
        Of the runs.

    Attributes
    ----------
    at_ns
        Time since the first run begins.
    rate
        How many times as fast as it was.
    is_playing
        Whether it goes.
    offsets_ns
        When each run begins.
    """

    def __init__(self, lengths_ns: Sequence[int]) -> None:
        self._lengths_ns = tuple(lengths_ns)
        self.offsets_ns = tuple(0 for _ in lengths_ns)
        self.at_ns = 0
        self.rate = 1.0
        self.is_playing = False
        self._stepped_ns = 0

    @property
    def end_ns(self) -> int:
        """Time at which the last run ends [ns]."""
        return max(map(sum, zip(self.offsets_ns, self._lengths_ns, strict=True)))

    def of_run(self, number: int) -> int:
        """Return the time shown of a run [ns]: its first before it begins, its last afterwards."""
        at_ns = self.at_ns - self.offsets_ns[number]
        return min(max(0, at_ns), self._lengths_ns[number])

    def seek(self, at_ns: int) -> None:
        """Go to a time."""
        self.at_ns = min(max(0, at_ns), self.end_ns)

    def play(self, rate: float, now_ns: int) -> None:
        """Go on from here; from the beginning where this is the end."""
        self.rate, self.is_playing, self._stepped_ns = rate, True, now_ns
        if self.at_ns >= self.end_ns:
            self.at_ns = 0

    def pause(self) -> None:
        """Stand still."""
        self.is_playing = False

    def align(self, marks_ns: Sequence[int]) -> None:
        """Let a time of each run be the same; the present of the first stays."""
        before_ns = self.offsets_ns[0]
        self.offsets_ns = tuple(max(marks_ns) - each for each in marks_ns)
        self.seek(self.at_ns + self.offsets_ns[0] - before_ns)

    def step(self, now_ns: int) -> None:
        """Go as far as the rate says until a time of the computer's clock."""
        if self.is_playing:
            self.seek(self.at_ns + round(self.rate * (now_ns - self._stepped_ns)))
            self._stepped_ns = now_ns
            self.is_playing = self.at_ns < self.end_ns
