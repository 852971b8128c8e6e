"""The console that commands print to."""

from __future__ import annotations

from rich.console import Console


def plain_console(*, stderr: bool = False) -> Console:
    """Return a console that prints texts as they are: names may look like markup or emoji."""
    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def say_compiling(console: Console, end: str = "") -> None:
    """Say that inner loops are compiled first, where they are not kept from an earlier run."""
    from robotctl.compiled import COMPILING, cache_is_cold  # noqa: PLC0415 - it loads numba

    if cache_is_cold():
        console.print(f"{COMPILING}{end}", soft_wrap=True)
