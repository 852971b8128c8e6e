"""Entries of a recorded log, by source, in the order of one clock that goes forward.

Every reader adds its entries in the order of the log, which is the order of events. Repeated
entries, and single ones with a time far from both neighbours, are left out. A clock that is set
makes times ambiguous: the log then has several stretches, of which the longest is read. A time that
goes back by less is held. All of this is noted.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from robotctl.logs.formats.times import FIRST_S, LAST_S, is_timeless

K = TypeVar("K", bound=Hashable)

HELD_NS: Final = 100_000_000
"""Maximum step back of a clock that was not set [ns]."""
_FORWARD_NS, _STEPS = 100_000 * 1_000_000_000, 1000
"""Minimum step forward of a clock that was set, as by NTP after a start in 1970: [ns], and in usual
steps."""
_FIRST_NS, _LAST_NS = int(FIRST_S) * 10**9, int(LAST_S) * 10**9
_REASONS: Final = 3


@dataclass(frozen=True, slots=True)
class Series:
    """Entries of one source, in the order of their times.

    Parameters
    ----------
    what
        Name of the source, for messages.
    stamps_ns
        Times, (n,) [ns], never decreasing.
    log_ns
        Time of reception of each by the log, (n,) [ns]; (0,) if unknown.
    values
        Content of the n entries.
    is_held
        Whether each time was held, since its clock went back, (n,).
    """

    what: str
    stamps_ns: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    values: list[Any]
    is_held: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.values)

    def with_times(self) -> Iterator[tuple[int, Any]]:
        """Yield time [ns] and value of each."""
        return zip(self.stamps_ns.tolist(), self.values, strict=True)


@dataclass(slots=True)
class _Source:
    """Entries of a source in the order of the log.

    Positions in the log are comparable among sources of one file.
    """

    file: int
    positions: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    log_ns: list[int] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)
    seen: set[int] = field(default_factory=set)
    repeated: int = 0
    refused: int = 0
    refused_ns: int = 0
    reasons: list[str] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Number of its entries in the log."""
        return len(self.values) + self.repeated + self.refused


class Timeline(Generic[K]):
    """Collects the entries of a log.

    Parameters
    ----------
    notes
        Sentences for people, extended with omissions and oddities.
    held_ns
        Maximum step back of a clock that is held, see `HELD_NS`.
    """

    def __init__(self, notes: list[str], held_ns: int = HELD_NS) -> None:
        self._notes = notes
        self._held_ns = held_ns
        self._sources: dict[K, _Source] = {}
        self._files = self._count = 0

    def sources(self) -> list[K]:
        """Return the sources so far, in the order of their first entries."""
        return list(self._sources)

    def add(
        self,
        source: K,
        stamp_ns: int,
        value: object,
        raw: Hashable | None,
        log_ns: int | None = None,
    ) -> None:
        """Add the next entry of the log.

        Parameters
        ----------
        source
            Source, with its name for people as text.
        stamp_ns
            Time [ns].
        value
            Content.
        raw
            Raw entry in the log: an equal one at the same time is a repetition. None: it may be
            repeated.
        log_ns
            Time of reception by the log, if known [ns].
        """
        if not all(_FIRST_NS <= each <= _LAST_NS for each in (stamp_ns, log_ns or 0)):
            self.leave_out(source, stamp_ns, "the time is before 1969 or after 2261")
            return
        entries = self._sources.setdefault(source, _Source(file=0))
        self._count += 1
        if raw is not None:
            key = hash((stamp_ns, raw))
            if key in entries.seen:
                entries.repeated += 1
                return
            entries.seen.add(key)
        entries.positions.append(self._count)
        entries.stamps_ns.append(stamp_ns)
        entries.values.append(value)
        if log_ns is not None:
            entries.log_ns.append(log_ns)

    def add_file(self, source: K, stamps_ns: Iterable[int], values: Iterable[object]) -> None:
        """Add all entries of a source with its own file."""
        self._files += 1
        entries = self._sources[source] = _Source(self._files)
        entries.stamps_ns, entries.values = list(stamps_ns), list(values)
        entries.positions = list(range(len(entries.values)))

    def leave_out(self, source: K, stamp_ns: int, reason: str) -> None:
        """Count an entry with impossible content."""
        entries = self._sources.setdefault(source, _Source(file=0))
        if not entries.refused:
            entries.refused_ns = stamp_ns
        entries.refused += 1
        if reason not in entries.reasons and len(entries.reasons) < _REASONS:
            entries.reasons.append(reason)

    def settled(self, details: Collection[K] = (), timeless: Collection[K] = ()) -> dict[K, Series]:
        """Return the valid entries by source; the others are noted.

        Parameters
        ----------
        details
            Sources that do not determine the log's stretches, and without notes.
        timeless
            Sources valid for the whole log, whatever their times; also treated as details.
        """
        details = {*details, *timeless}
        rows = {each: np.arange(len(found.values)) for each, found in self._sources.items()}
        cuts: dict[int, list[int]] = {}
        for source, found in self._sources.items():
            if source not in details:
                self._note_left_out(str(source), found)
                rows[source], positions = self._in_order(str(source), found)
                cuts.setdefault(found.file, []).extend(positions)
        for file, positions in cuts.items():
            if positions:
                self._keep_longest(file, sorted(positions), rows, details, timeless)
        return {
            source: self._series(source, rows[source], is_noted=source not in details)
            for source in self._sources
        }

    def _note_left_out(self, what: str, found: _Source) -> None:
        if found.repeated:
            self._notes.append(
                f"{found.repeated} of {found.total} {what} repeat an earlier one, left out"
            )
        if found.refused:
            self._notes.append(
                f"{found.refused} of {found.total} {what} left out: {', '.join(found.reasons)}; "
                f"the first at {seconds(found.refused_ns)} s"
            )

    def _in_order(self, what: str, found: _Source) -> tuple[NDArray[np.int64], list[int]]:
        """Return the rows without outlying times, and the positions of clock settings."""
        strays, cuts = _walk(found.stamps_ns, self._held_ns)
        if strays:
            at = min(strays)
            self._notes.append(
                f"{len(strays)} of {found.total} {what} left out: their time is far from that of "
                f"their neighbours; after {seconds(found.stamps_ns[at - 1])} s follows first "
                f"{seconds(found.stamps_ns[at])} s"
            )
        for at in cuts:
            before_ns, after_ns = found.stamps_ns[at - 1], found.stamps_ns[at]
            self._notes.append(
                f"{what}: their clock is set {'back' if after_ns < before_ns else 'forward'} by "
                f"{1e-9 * abs(after_ns - before_ns):.3f} s at {seconds(before_ns)} s"
            )
        keep = np.ones(len(found.values), bool)
        keep[strays] = False
        return np.flatnonzero(keep), [found.positions[at] for at in cuts]

    def _keep_longest(
        self,
        file: int,
        cuts: list[int],
        rows: dict[K, NDArray[np.int64]],
        details: Collection[K],
        timeless: Collection[K],
    ) -> None:
        """Leave out all but the longest stretch between two cuts."""
        here = {
            each: found
            for each, found in self._sources.items()
            if found.file == file and each not in timeless
        }
        positions = {
            each: np.array(found.positions, np.int64)[rows[each]] for each, found in here.items()
        }
        edges = np.array([-1, *cuts, np.iinfo(np.int64).max])
        counts = sum(
            np.histogram(positions[each], edges)[0] for each in here if each not in details
        )
        longest = int(np.argmax(counts))
        begin, end = edges[longest], edges[longest + 1]
        left_out = []
        for each, found in here.items():
            is_inside = (positions[each] >= begin) & (positions[each] < end)
            lost = len(is_inside) - int(np.count_nonzero(is_inside))
            if lost and each not in details:
                left_out.append(f"{lost} of {found.total} {each}")
            rows[each] = rows[each][is_inside]
        self._notes.append(
            f"the longest of {len(cuts) + 1} stretches of the log between such times is read; left "
            f"out are {', '.join(left_out) or 'none'}"
        )

    def _series(self, source: K, rows: NDArray[np.int64], *, is_noted: bool) -> Series:
        """Return the chosen entries of a source, with times that go back held."""
        found, what = self._sources[source], str(source)
        stamps_ns = np.array(found.stamps_ns, np.int64)[rows]
        ordered_ns = np.maximum.accumulate(stamps_ns)
        is_held = ordered_ns != stamps_ns
        held = int(np.count_nonzero(is_held))
        if held and is_noted:
            self._notes.append(f"{held} of {found.total} {what}: their clock goes back, time held")
        if is_noted and is_timeless(ordered_ns):
            self._notes.append(
                f"all {len(ordered_ns)} {what} have one time, {seconds(int(ordered_ns[0]))} s: "
                "only their order is known"
            )
        log_ns = np.array(found.log_ns, np.int64)
        return Series(
            what, ordered_ns, log_ns[rows] if len(log_ns) else log_ns,
            [found.values[row] for row in rows.tolist()], is_held,
        )  # fmt: skip


def seconds(stamp_ns: int) -> str:
    """Return a time [ns] as seconds, for messages."""
    return f"{1e-9 * stamp_ns:.15g}"


def _walk(stamps_ns: list[int], held_ns: int) -> tuple[list[int], list[int]]:
    """Return the times far from both neighbours, and those at which the clock was set."""
    strays: list[int] = []
    cuts: list[int] = []
    times = np.array(stamps_ns, np.int64)
    steps_ns = np.diff(times)
    forward_ns = max(
        _FORWARD_NS, _STEPS * int(np.median(np.abs(steps_ns))) if len(times) > 1 else 0
    )
    goes_back = np.any(times < np.maximum.accumulate(times) - held_ns)
    if not goes_back and not np.any(steps_ns > forward_ns):
        return strays, cuts
    last_ns = stamps_ns[0]
    for at, now_ns in enumerate(stamps_ns[1:], 1):
        next_ns = stamps_ns[at + 1] if at + 1 < len(stamps_ns) else None
        goes_on = next_ns is not None and last_ns - held_ns <= next_ns <= last_ns + forward_ns
        is_back = now_ns < last_ns - held_ns
        if goes_on and (is_back or (next_ns is not None and now_ns > next_ns + held_ns)):
            strays.append(at)
        elif is_back or now_ns > last_ns + forward_ns:
            cuts.append(at)
            last_ns = now_ns
        else:
            last_ns = max(last_ns, now_ns)
    return strays, cuts
