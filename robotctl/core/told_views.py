"""Mission and bounds as messages: when they change, and every two seconds."""

from __future__ import annotations

from typing import Final, TypeAlias

import msgspec

from robotctl.messages.plans import BoundsView, MissionView

Told: TypeAlias = MissionView | BoundsView

_AGAIN_NS: Final = 2_000_000_000
"""Interval at which late subscribers are told what has not changed [ns]."""


class ToldViews:
    """Chooses which views are due."""

    def __init__(self) -> None:
        self._last: dict[type[Told], Told] = {}

    def due(self, *views: Told) -> list[Told]:
        """Return the views that differ from the last ones, or were last returned long ago."""
        due = []
        for view in views:
            last = self._last.get(type(view))
            if last is not None:
                same = msgspec.structs.replace(view, stamp_ns=last.stamp_ns) == last
                if same and view.stamp_ns - last.stamp_ns < _AGAIN_NS:
                    continue
            self._last[type(view)] = view
            due.append(view)
        return due
