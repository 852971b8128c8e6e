"""How often something may happen."""

from __future__ import annotations


class RateLimit:
    """Token bucket.

    Parameters
    ----------
    per_s
        Allowed rate [Hz].
    burst
        Allowed at once; None: as many as in a second.
    """

    def __init__(self, per_s: int, burst: int | None = None) -> None:
        self._per_s = per_s
        self._most = float(per_s if burst is None else burst)
        self._left = self._most
        self._seen_ns: int | None = None

    def allows(self, now_ns: int, count: int = 1) -> bool:
        """Count one, or several, if they are within the limit; return whether they are."""
        if self._seen_ns is not None:
            gained = (now_ns - self._seen_ns) * 1e-9 * self._per_s
            self._left = min(self._most, self._left + gained)
        self._seen_ns = now_ns
        if count > self._left:
            return False
        self._left -= count
        return True
