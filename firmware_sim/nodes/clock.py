"""A node's own clock, whose oscillator may drift."""

from __future__ import annotations

PPM = 1e-6


class LocalClock:
    """A node's own time, and the true length of its intervals; exact without drift."""

    def __init__(self) -> None:
        self._ppm = 0.0
        self._read_ns = self._true_ns = 0

    def reset(self, now_ns: int) -> None:
        """Restart at 0, as at power-up; the drift stays."""
        self._read_ns, self._true_ns = 0, now_ns

    def drift(self, ppm: float, now_ns: int) -> None:
        """Run faster by some parts per million from now on."""
        self._read_ns, self._true_ns = self.read(now_ns), now_ns
        self._ppm += ppm

    def read(self, now_ns: int) -> int:
        """Return the node's own time since power-up [ns]."""
        elapsed_ns = now_ns - self._true_ns
        gained_ns = round(elapsed_ns * self._ppm * PPM) if self._ppm else 0
        return self._read_ns + elapsed_ns + gained_ns

    def span_ns(self, own_ns: int) -> int:
        """Return the true length of an interval of `own_ns` on the node's clock [ns]."""
        return round(own_ns / (1.0 + self._ppm * PPM)) if self._ppm else own_ns
