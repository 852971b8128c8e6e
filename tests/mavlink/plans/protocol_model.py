"""The mission protocol as https://mavlink.io/en/services/mission.html has it, for one kind of plan.

A model to hold the robot's answers against: it knows stations and messages by name and items by a
label, and no MAVLink. What the page leaves open is decided as docs/mavlink.md says.
"""

from collections import deque
from dataclasses import dataclass, field

ACCEPTED, ERROR, INVALID_PARAM7, NO_SPACE = 0, 1, 12, 4
INVALID_SEQUENCE, DENIED, CANCELLED = 13, 14, 15
MOST_ITEMS = 1000
GIVEN_UP_MS, READING_MS = 8000, 5000
HOME = "home"


@dataclass
class Upload:
    """A station's items: those that stay, those that came, and how many it has announced."""

    station: str
    count: int
    items: list = field(default_factory=list)
    behind: tuple = ()
    requested_ms: int | None = None

    @property
    def last(self):
        return min(len(self.items), self.count - 1)


@dataclass
class Model:
    """One kind of plan, of which the first `homes` items are sent but are no part of it."""

    homes: int = 0
    plan: tuple = ()
    is_there: bool = True
    """Whether navigation still has that plan: it may have taken the next one already."""
    upload: Upload | None = None
    undecided: deque = field(default_factory=deque)
    """Plans that navigation is to take, with those who wait: stations, or an upload."""
    ended: dict = field(default_factory=dict)
    """Number of the last item of each station's upload, and how that ended, once it is known."""
    reading: dict = field(default_factory=dict)
    listing: dict = field(default_factory=dict)
    """Stations that asked for the list while navigation decided."""
    replies: list = field(default_factory=list)
    now_ms: int = 0

    @property
    def state(self):
        if self.upload is None:
            return "deciding" if self.undecided else "idle"
        return "waiting" if self.undecided else "receiving"

    @property
    def listed(self):
        return (HOME,) * self.homes + self.plan if self.plan and self.is_there else ()

    def wanted(self, station):
        """Return the number of the item that a station is asked for; None: of none."""
        upload = self.upload
        if upload is None or upload.station != station or upload.requested_ms is None:
            return None
        return len(upload.items)

    # What stations send.

    def count(self, station, count):
        if not self._may_change(station):
            return
        if count > MOST_ITEMS:
            self._ack(station, NO_SPACE)
        elif count == 0:
            self._offer((), station)
        else:
            self.upload = Upload(station, count)

    def partial(self, station, first, last):
        if self.undecided:
            self._ack(station, DENIED)
        elif self._may_change(station):
            items = self.listed
            if 0 <= first <= last < len(items):
                self.upload = Upload(station, last + 1, list(items[:first]), items[last + 1 :])
            else:
                self._ack(station, INVALID_SEQUENCE)

    def clear(self, station):
        if self._may_change(station):
            self._offer((), station)

    def item(self, station, seq, label, good):
        upload = self.upload
        if upload is None or upload.station != station:
            last, result = self.ended.get(station, (-1, None))
            if seq > last:
                self._ack(station, ERROR if upload is None else DENIED)
            elif seq == last and result is not None:
                self._ack(station, result)
        elif seq == self.wanted(station) and not good:
            self._end(upload, INVALID_PARAM7)
        elif seq == self.wanted(station):
            upload.items.append(label)
            upload.requested_ms = None
            if len(upload.items) == upload.count:
                self.upload, self.ended[station] = None, (upload.last, None)
                whole = (*upload.items, *upload.behind)
                self._offer(whole[self.homes :], upload)

    def ack(self, station, result):
        self.reading.pop(station, None)
        if result != ACCEPTED and self.upload is not None and self.upload.station == station:
            self.upload, self.ended[station] = None, (self.upload.last, None)

    def list(self, station):
        if self.undecided:
            self.listing.setdefault(station)
            return
        self.reading[station] = self.listed, self.now_ms
        self.replies.append((station, "COUNT", len(self.listed)))

    def request(self, station, seq):
        items, heard_ms = self.reading.get(station, ((), 0))
        if items and self.now_ms - heard_ms <= READING_MS:
            self.reading[station] = items, self.now_ms
        else:
            items = self.listed or (HOME,) * self.homes
        if seq < len(items):
            self.replies.append((station, "ITEM", seq, items[seq]))
        else:
            self._ack(station, INVALID_SEQUENCE)

    # What happens by itself.

    def go_on(self, now_ms):
        """Ask for what is wanted next; give up what has not come."""
        self.now_ms, upload = now_ms, self.upload
        if self.undecided:
            return
        asked, self.listing = self.listing, {}
        for station in asked:
            self.list(station)
        if upload is None:
            return
        if upload.requested_ms is None:
            upload.requested_ms = now_ms
            self.replies.append((upload.station, "REQUEST", len(upload.items)))
        elif now_ms - upload.requested_ms >= GIVEN_UP_MS:
            self._end(upload, CANCELLED)

    def decide(self, taken):
        """Let navigation take the first plan, or refuse it."""
        plan, waiting = self.undecided.popleft()
        if taken:
            self.plan = plan
        for who in waiting:
            result = ACCEPTED if taken else DENIED
            self._end(who, result) if isinstance(who, Upload) else self._ack(who, result)

    def _may_change(self, station):
        if self.upload is not None and self.upload.station != station:
            self._ack(station, DENIED)
            return False
        self.upload = None
        self.ended.pop(station, None)
        self.reading.pop(station, None)
        return True

    def _offer(self, plan, who):
        if not plan and self.undecided and not self.undecided[-1][0]:
            self.undecided[-1][1].append(who)
        else:
            self.undecided.append((plan, [who]))

    def _end(self, upload, result):
        if self.upload is upload:
            self.upload = None
        self.ended[upload.station] = upload.last, result
        self._ack(upload.station, result)

    def _ack(self, station, result):
        self.replies.append((station, "ACK", result))
