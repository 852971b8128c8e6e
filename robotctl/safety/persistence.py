"""How long a condition has held."""

from __future__ import annotations


class PersistenceTimer:
    """How long a condition has held without a break."""

    __slots__ = ("_since_ns",)

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def lasts_ns(self, condition: bool, now_ns: int) -> int:
        """Return how long the condition has held up to now [ns]; 0 if it does not."""
        if not condition:
            self._since_ns = None
            return 0
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns
