"""Unknown senders on the bus: frames that prove one, counted by kind."""

from __future__ import annotations

import msgspec

from robotctl.messages.control import Stranger, StrangerKind


class StrangerBook:
    """Counts the frames of unknown senders.

    Attributes
    ----------
    seen
        All of it since the start; the same object as long as nothing is new.
    """

    def __init__(self) -> None:
        self.seen: tuple[Stranger, ...] = ()
        self._kinds: dict[tuple[StrangerKind, str, str], Stranger] = {}
        self._is_new = False

    def note(
        self, kind: StrangerKind, name: str, arbitration_id: int, node: str, stamp_ns: int
    ) -> None:
        """Count a frame received at `stamp_ns` [ns]; `name` and `node` are those of `Stranger`."""
        key = (kind, name, node)
        known = self._kinds.get(key)
        if known is None:
            known = Stranger(kind, name, arbitration_id, node, 0, stamp_ns, stamp_ns)
        self._kinds[key] = msgspec.structs.replace(known, count=known.count + 1, stamp_ns=stamp_ns)
        self._is_new = True

    def note_refused(self, kind: StrangerKind, name: str, node: str) -> None:
        """Count that a node refused the last frame of a kind."""
        key = (kind, name, node)
        known = self._kinds[key]
        self._kinds[key] = msgspec.structs.replace(known, refused=known.refused + 1)
        self._is_new = True

    def refresh(self) -> None:
        """Bring `seen` up to date, once for all frames of a tick."""
        if self._is_new:
            self._is_new = False
            self.seen = tuple(self._kinds.values())
