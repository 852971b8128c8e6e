"""The upload of a mission: asks for one item after the other until it has all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robotctl.mavlink.missions.item import MissionItem
from robotctl.messages.mavlink_port import Peer

AGAIN_NS: Final = 1_000_000_000
"""An item that does not come is asked for again after this [ns]."""
MOST_TRIES: Final = 8
"""So often; then the upload is given up, and the robot keeps the mission that it has."""


class Upload:
    """The items that one ground station sends.

    Parameters
    ----------
    partner, peer
        Address of the sender, and its connection.
    count
        Of the last item that is wanted, and those before it: at least 1.
    now_ns
        Time of the first request [ns].
    before, behind
        Items that stay as they are: the first ones, and those after `count`.
    """

    def __init__(
        self,
        partner: tuple[int, int],
        peer: Peer,
        count: int,
        now_ns: int,
        before: Sequence[MissionItem] = (),
        behind: Sequence[MissionItem] = (),
    ) -> None:
        self.partner = partner
        self.peer = peer
        self.count = count
        self.items = list(before)
        self._behind = tuple(behind)
        self._asked_ns = now_ns
        self._tries = 1
        self._is_old: bool | None = None
        """Whether the sender answers the older MISSION_REQUEST; None: it has answered nothing."""

    @property
    def wanted(self) -> int:
        """Number of the next item."""
        return len(self.items)

    @property
    def is_complete(self) -> bool:
        """Whether all have come."""
        return len(self.items) == self.count

    @property
    def whole(self) -> list[MissionItem]:
        """All items of the plan, once the upload is complete."""
        return [*self.items, *self._behind]

    @property
    def asks_old(self) -> bool:
        """Whether to ask by the older MISSION_REQUEST.

        A sender that knows nothing else, as dronekit, is silent at first: one that is silent is
        asked in turns, and from then on as it has answered.
        """
        return self._tries % 2 == 0 if self._is_old is None else self._is_old

    def take(self, item: MissionItem, now_ns: int) -> None:
        """Take the next item."""
        self._is_old = self.asks_old
        self.items.append(item)
        self._asked_ns, self._tries = now_ns, 1

    def asks_again(self, now_ns: int) -> bool:
        """Return whether the wanted item is to be asked for again; note that it is."""
        if now_ns - self._asked_ns < AGAIN_NS:
            return False
        self._asked_ns = now_ns
        self._tries += 1
        return True

    @property
    def is_given_up(self) -> bool:
        """Whether the sender has been silent for too long."""
        return self._tries > MOST_TRIES
