"""The upload of a plan: asks for one item after the other until it has all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from robotctl.mavlink.missions.item import MissionItem
from robotctl.messages.mavlink_port import Address, Peer

AGAIN_NS: Final = 1_000_000_000
"""Time after which a missing item is requested again [ns]."""
SOON_NS: Final = 100_000_000
"""Least time between two requests for one item [ns]: on links that double every frame, a request
for each copy would double the traffic with every item."""
LONGEST_NS: Final = 8_000_000_000
"""Wait for one item after which an upload is given up, and the robot keeps the plan that it has
[ns]."""


class Upload:
    """The items that one ground station sends.

    Parameters
    ----------
    partner, peer
        Address of the sender, and its connection.
    count
        Number of the last item that is wanted, plus one: at least 1.
    now_ns
        When the first item may be requested [ns].
    before, behind
        Items that stay as they are: the first ones, and those after `count`.
    """

    def __init__(
        self,
        partner: Address,
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
        self._due_ns = now_ns
        self._requested_ns = self._began_ns = now_ns
        """When the wanted item was requested last, and first [ns]."""
        self._tries = 0
        self._is_old: bool | None = None
        """Whether the sender answers the older MISSION_REQUEST; None: it has answered nothing."""

    @property
    def wanted(self) -> int:
        """Number of the next item."""
        return len(self.items)

    @property
    def last(self) -> int:
        """Number of the last item that has come or is wanted."""
        return min(len(self.items), self.count - 1)

    @property
    def has_requested(self) -> bool:
        """Whether the wanted item was requested: one that comes unasked is of an earlier upload."""
        return self._tries > 0

    @property
    def is_complete(self) -> bool:
        """Whether all items have come."""
        return len(self.items) == self.count

    @property
    def whole(self) -> list[MissionItem]:
        """All items of the plan, once the upload is complete."""
        return [*self.items, *self._behind]

    @property
    def uses_old_request(self) -> bool:
        """Whether the last request was the older MISSION_REQUEST.

        A sender that knows nothing else, as dronekit, is silent at first: one that is silent is
        asked in turns, and from then on as it has answered.
        """
        return self._tries % 2 == 0 if self._is_old is None else self._is_old

    def take(self, item: MissionItem, now_ns: int) -> None:
        """Take the wanted item, which was requested; the one after it is due at once."""
        self._is_old = self.uses_old_request
        self.items.append(item)
        self._due_ns, self._tries = now_ns, 0

    def hurry(self) -> None:
        """Request the wanted item soon: the sender seems not to have heard the last request."""
        self._due_ns = min(self._due_ns, self._requested_ns + SOON_NS)

    def is_due(self, now_ns: int) -> bool:
        """Return whether the wanted item is to be requested."""
        return now_ns >= self._due_ns

    def note_request(self, now_ns: int) -> None:
        """Note that the wanted item is requested now."""
        if not self._tries:
            self._began_ns = now_ns
        self._requested_ns, self._due_ns = now_ns, now_ns + AGAIN_NS
        self._tries += 1

    def is_given_up(self, now_ns: int) -> bool:
        """Return whether the sender has left all requests for an item unanswered."""
        return self._tries > 0 and now_ns - self._began_ns >= LONGEST_NS
