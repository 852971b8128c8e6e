"""Notes shared by the parts on a bus: other senders, damaged frames, emergency messages."""

from __future__ import annotations

from robotctl.drivers.can.e2e import E2eCounters
from robotctl.drivers.can.stranger_book import StrangerBook
from robotctl.messages.control import EmergencyMessage


class BusNotes:
    """Notes about one bus, or about all of a robot's.

    Attributes
    ----------
    strangers
        Frames that prove another sender.
    counters
        Rejected and lost frames of those that carry a counter and a checksum.
    emergencies
        Emergency messages of the present tick.
    refused
        Commands since the start that no frame can carry, sent as "no power".
    """

    def __init__(self) -> None:
        self.strangers = StrangerBook()
        self.counters = E2eCounters()
        self.emergencies: list[EmergencyMessage] = []
        self.refused = 0
