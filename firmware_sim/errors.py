"""The exceptions of the firmware simulator, and what their messages suggest."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class SimulationError(Exception):
    """A robot or world file is invalid, or simulation is impossible; one line for each error."""


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return `; did you mean "..."?` for the name nearest to `word`; nothing if none is near."""
    near = difflib.get_close_matches(word, list(allowed), n=1)
    return f'; did you mean "{near[0]}"?' if near else ""
