"""`robotctl compile`: all inner loops to machine code, so that no later start waits for that."""

from __future__ import annotations

import time
from typing import Final

from rich.console import Console

from native_kernels.cache import cache_of
from native_kernels.library import found_library
from robotctl.cli.console import plain_console
from robotctl.words import counted
from robotctl.workbench.compile.compile import CompileError, Kernels

_LINE_S: Final = 10.0
"""Time between two lines where there is no terminal."""


def compile_all() -> None:
    """Compile all inner loops for this processor, so that no robot and no command waits for it.

    What is compiled stays beside the package where that can be written to, else in the user's
    cache; a complete one beside the package, or a wheel of this platform, serves all users. Status
    2: no folder takes it.
    """
    kernels, console = Kernels(), plain_console(stderr=True)
    library = found_library("robotctl")
    kept = cache_of("robotctl").folder if library is None else library.parent
    if kept and not kernels.missing and not kernels.lack_library:
        done = f"{counted(kernels.total, 'function')} compiled already"
        console.print(f"{done}, kept in {kept}", soft_wrap=True)
        return
    _compile(kernels, console)


def compile_missing(*, simulated: bool) -> None:
    """Compile what is missing before a robot's time begins, and say so.

    Where it cannot be kept the robot starts all the same, and compiles while it does.
    """
    kernels, console = Kernels(simulated), plain_console(stderr=True)
    if why := kernels.missing:
        console.print(f"compiling the inner loops first, once: {why}", soft_wrap=True)
        try:
            _compile(kernels, console)
        except CompileError as error:
            console.print(f"note: {error}", soft_wrap=True)


def _compile(kernels: Kernels, console: Console) -> None:
    """Compile behind a bar or, without a terminal, a line now and then."""
    from rich.progress import (  # noqa: PLC0415 - few runs compile
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    began_s = told_s = time.monotonic()
    columns = (TextColumn("compiling"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=kernels.total)

        def tell(done: int, total: int) -> None:
            nonlocal told_s
            bar.update(task, completed=done)
            if not console.is_terminal and time.monotonic() - told_s > _LINE_S:
                told_s = time.monotonic()
                console.print(f"{done} of {total} functions, {told_s - began_s:.0f} s")

        without = kernels.compile(tell)
    took_s = time.monotonic() - began_s
    where = cache_of("robotctl").folder
    console.print(
        f"{counted(kernels.total, 'function')} compiled in {took_s:.0f} s, kept in {where}",
        soft_wrap=True,
    )
    if without:
        console.print(
            f"note: each process that uses them loads numba, 1 s and 200 MB more: {without}",
            soft_wrap=True,
        )
