"""The console that commands print to."""

from __future__ import annotations

from rich.console import Console


def plain_console(*, stderr: bool = False) -> Console:
    """Return a console that prints texts as they are: names may look like markup or emoji."""
    return Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def say_compiling(console: Console, end: str = "") -> None:
    """Say that inner loops are compiled, and how far, from the first that is not kept on."""
    from robotctl.app.compile_progress import announce_compiling  # noqa: PLC0415 - it loads numba

    announce_compiling(lambda text: console.print(f"{text}{end}", soft_wrap=True))
