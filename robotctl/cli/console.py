"""The console that commands print to."""

from __future__ import annotations

from rich.console import Console


def plain_console(*, stderr: bool = False) -> Console:
    """Return a console that prints texts as they are: names may look like markup or emoji."""
    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)
