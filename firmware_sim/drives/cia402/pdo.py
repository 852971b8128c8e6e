"""PDOs of a node by its mapping objects (CiA 301, 7.5.2): received into, sent from a dictionary."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from firmware_sim.drives.cia402.objects import INVALID, PDOS
from firmware_sim.drives.twin import NEVER_NS
from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.variables import Key, SdoAbortError

_ID: Final = 0x7FF
_SYNC_MAX: Final = 240
"""Greatest transmission type that counts SYNCs."""


@dataclass(slots=True)
class _Pdo:
    """Configuration of one PDO."""

    identifier: int
    every: int
    period_ns: int
    parts: list[tuple[Key, int]]
    syncs: int = 0
    due_ns: int = NEVER_NS
    waiting: bytes | None = None

    @property
    def size(self) -> int:
        """Length of the frame [byte]."""
        return sum(size for _, size in self.parts)


class Pdos:
    """All PDOs of a node.

    Parameters
    ----------
    dictionary
        Its objects.
    send
        Function that sends a frame.
    event_ns
        Unit of the event timers [ns].
    on_short
        Called when a frame was too short for its mapping.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        send: Callable[[int, bytes], None],
        event_ns: int,
        on_short: Callable[[], None],
    ) -> None:
        self._dictionary = dictionary
        self._send = send
        self._event_ns = event_ns
        self._on_short = on_short
        self._received: dict[int, _Pdo] = {}
        self._sent: list[_Pdo] = []
        self.is_stale = True
        """Whether the configuration was written since `refresh`."""

    def refresh(self, now_ns: int) -> None:
        """Apply the configuration."""
        self.is_stale = False
        received = (self._configured(0x1400 + n, 0x1600 + n) for n in range(PDOS))
        self._received = {pdo.identifier: pdo for pdo in received if pdo is not None}
        sent = (self._configured(0x1800 + n, 0x1A00 + n) for n in range(PDOS))
        self._sent = [pdo for pdo in sent if pdo is not None]
        for pdo in self._sent:
            if pdo.period_ns:
                pdo.due_ns = now_ns + pdo.period_ns

    def _configured(self, communication: int, mapping: int) -> _Pdo | None:
        """Return a PDO; None if it is switched off."""
        number = self._dictionary.number
        identifier = number(communication, 1)
        if identifier & INVALID:
            return None
        parts = []
        for sub in range(1, number(mapping, 0) + 1):
            entry = number(mapping, sub)
            parts.append(((entry >> 16, entry >> 8 & 0xFF), (entry & 0xFF) // 8))
        kind = number(communication, 2)
        is_sync = kind <= _SYNC_MAX
        period_ns = 0 if is_sync else number(communication, 5) * self._event_ns
        return _Pdo(identifier & _ID, max(kind, 1) if is_sync else 0, period_ns, parts)

    def on_frame(self, identifier: int, data: bytes) -> bool:
        """Take a received PDO; return whether its values are in force now."""
        pdo = self._received.get(identifier)
        if pdo is None:
            return False
        if len(data) < pdo.size:
            self._on_short()
            return False
        if pdo.every:
            pdo.waiting = data
            return False
        self._store(pdo, data)
        return True

    def _store(self, pdo: _Pdo, data: bytes) -> None:
        start = 0
        for (index, sub), size in pdo.parts:
            part = data[start : start + size]
            start += size
            try:
                variable = self._dictionary.variable(index, sub)
                self._dictionary.force(index, sub, variable.from_bytes(part))
            except SdoAbortError:
                continue  # a value out of range: the last one stays

    def on_sync(self) -> None:
        """Apply received values, and send the PDOs due with this SYNC."""
        for pdo in self._received.values():
            if pdo.waiting is not None:
                data, pdo.waiting = pdo.waiting, None
                self._store(pdo, data)
        for pdo in self._sent:
            if pdo.every:
                pdo.syncs += 1
                if pdo.syncs >= pdo.every:
                    pdo.syncs = 0
                    self._transmit(pdo)

    def on_change(self) -> None:
        """Send the event-driven PDOs at once."""
        for pdo in self._sent:
            if not pdo.every:
                self._transmit(pdo)

    def step(self, now_ns: int) -> None:
        """Send the PDOs whose event timers have ended."""
        for pdo in self._sent:
            if now_ns >= pdo.due_ns:
                pdo.due_ns += pdo.period_ns
                self._transmit(pdo)

    @property
    def due_ns(self) -> int:
        """End of the next event timer [ns]."""
        return min((pdo.due_ns for pdo in self._sent), default=NEVER_NS)

    def _transmit(self, pdo: _Pdo) -> None:
        data = b"".join(
            self._dictionary.upload(index, sub)[:size] for (index, sub), size in pdo.parts
        )
        self._send(pdo.identifier, data)
