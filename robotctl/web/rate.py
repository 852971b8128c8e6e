"""How often something may happen."""

from __future__ import annotations


class RateLimit:
    """Token bucket: so many a second, and as many at once.

    Parameters
    ----------
    per_s
        Allowed rate [Hz].
    """

    def __init__(self, per_s: int) -> None:
        self._per_s = per_s
        self._left = float(per_s)
        self._seen_ns: int | None = None

    def allows(self, now_ns: int) -> bool:
        """Count one; return whether it is within the limit."""
        if self._seen_ns is not None:
            gained = (now_ns - self._seen_ns) * 1e-9 * self._per_s
            self._left = min(float(self._per_s), self._left + gained)
        self._seen_ns = now_ns
        self._left -= 1.0
        return self._left >= 0.0
