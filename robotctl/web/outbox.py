"""Queue of messages for one client.

Pictures of the present (poses, scans, particles, maps) replace each other: a client that is slow
sees fewer of them and none late. What people must know, notices and changes of state, is kept and
sent first; a client for whom too much of that has gathered is hopelessly behind.
"""

from __future__ import annotations

from collections import deque
from typing import Final

PERIOD_NS: Final = 50_000_000
"""Mean period of the pictures of one topic to one client [ns]."""

MAX_KEPT: Final = 256
"""Most messages that are kept for a client."""
MAX_KEPT_BYTES: Final = 1 << 20


class Outbox:
    """Messages for one client, not yet sent."""

    def __init__(self) -> None:
        self._kept: deque[tuple[str, bytes]] = deque()
        self._kept_bytes = 0
        self._pictures: dict[str, bytes] = {}
        """Waiting messages by topic, the oldest first."""
        self._due_ns: dict[str, int] = {}

    @property
    def is_hopeless(self) -> bool:
        """Whether more is kept than a client that reads at all could leave."""
        return len(self._kept) > MAX_KEPT or self._kept_bytes > MAX_KEPT_BYTES

    def keep(self, topic: str, data: bytes) -> None:
        """Add a message that must arrive; a picture of the topic that is older need not."""
        self._pictures.pop(topic, None)
        self._kept.append((topic, data))
        self._kept_bytes += len(data)

    def show(self, topic: str, data: bytes) -> None:
        """Add a picture in place of the last of its topic."""
        self._pictures[topic] = data

    def next(self, now_ns: int) -> bytes | None:
        """Return what to send now and forget it; None: nothing."""
        if self._kept:
            topic, data = self._kept.popleft()
            self._kept_bytes -= len(data)
            self._spend(topic, now_ns)
            return data
        for topic in self._pictures:
            if self._due_ns.get(topic, 0) <= now_ns:
                self._spend(topic, now_ns)
                return self._pictures.pop(topic)
        return None

    def _spend(self, topic: str, now_ns: int) -> None:
        """Let the next picture of a topic wait; one period may be made up for."""
        self._due_ns[topic] = max(self._due_ns.get(topic, 0), now_ns - PERIOD_NS) + PERIOD_NS
