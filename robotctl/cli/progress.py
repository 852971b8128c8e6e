"""The progress bar of work on a recorded log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def progress_bar(console: Console, name: str, work: str) -> Iterator[Callable[[int, int], None]]:
    """Show that the log `name` is read, then how far `work` is; nothing if no terminal is.

    Yields
    ------
    Callable
        Called with the amount done, and the total.
    """
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(f"reading {name}", total=None)

        def tell(done: int, total: int) -> None:
            bar.update(task, description=work, completed=done, total=total)

        yield tell
