"""`robotctl campaign`: many simulated runs, and what they show."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from typer.exceptions import TyperException

from robotctl.app.supervision.signals import CtrlC
from robotctl.cli.campaign.corpus import ROBOTCTL, keep_failures, run_again
from robotctl.cli.compile import compile_missing
from robotctl.cli.console import plain_console
from robotctl.cli.files import write_file
from robotctl.errors import ConfigError
from robotctl.words import counted

if TYPE_CHECKING:
    from rich.console import Console

    from robotctl.workbench.campaign.engine import Tell, Workers
    from robotctl.workbench.campaign.results import Head, Result
    from robotctl.workbench.campaign.statistics import Summary

FAILED: Final = 3
INTERRUPTED: Final = 130
_LINE_S: Final = 10.0
"""Time between two lines where there is no terminal [s]."""


def campaign(
    file: Annotated[
        Path | None, typer.Argument(help="Campaign file; docs/campaigns.md has its keys.")
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Folder of the results, which goes on where it ended; default: campaign-NAME.",
        ),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=0, help="Runs at a time; 0, the default: one for each processor.")
    ] = 0,
    scheduler: Annotated[
        str,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Run on the workers of this Dask scheduler; needs the extra `campaign`.",
        ),
    ] = "",
    corpus: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Make one failure of each kind small, and keep it in this folder.",
        ),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Run what --corpus kept, instead of a file."),
    ] = None,
) -> None:
    """Drive many simulated runs of robots, missions, faults and settings, and judge them.

    Each is `robotctl sim --lockstep` in a process of its own, or with `buses` in the file one in
    real time. The same command goes on after Ctrl-C or a kill, and repeats runs without a result.
    Status 0: all runs passed. 3: some failed, or have no result. 2: bad input. 4: the disk did not
    take all. 130: interrupted.
    """
    if (file is None) == (again is None):
        raise ConfigError("one is needed: a campaign file, or --again FOLDER")
    if again is not None and (results or scheduler or corpus):
        raise ConfigError("--again: not allowed with --results, --scheduler and --corpus")
    if scheduler and workers:
        raise ConfigError("--workers: not allowed with --scheduler, whose workers are all used")
    if again is not None:
        compile_missing(simulated=True)
        with _workers("", workers, ()) as chosen:
            passed = run_again(again, chosen, _option_problem, plain_console())
    elif file is not None:
        passed = _drive(file, results or Path(f"campaign-{file.stem}"), workers, scheduler, corpus)
    if not passed:
        sys.exit(FAILED)


def _drive(file: Path, place: Path, count: int, scheduler: str, corpus: Path | None) -> bool:
    """Drive a campaign whose results go to a folder; return whether all runs passed."""
    from robotctl.workbench.campaign.checked_file import load_campaign  # noqa: PLC0415 - numpy
    from robotctl.workbench.campaign.plan import (  # noqa: PLC0415
        command_of,
        files_of,
        fingerprint,
        plan,
        runs_in_all,
        sources_fingerprint,
    )
    from robotctl.workbench.campaign.results import HEAD, PAGE, ResultFolder, head_of  # noqa: PLC0415

    loaded = load_campaign(file, _option_problem)
    options = {"--scheduler": scheduler, "--workers": count, "--corpus": corpus}
    unfit = next((name for name, value in options.items() if value), "")
    if loaded.buses and unfit:
        why = "such runs go on this computer, one on each bus, and cannot be repeated exactly"
        raise ConfigError(f"{unfit}: not allowed with buses in {file}: {why}")
    runs = plan(loaded)
    files = files_of(loaded)
    prints = fingerprint(loaded, files), sources_fingerprint()
    head = head_of(file.stem, runs_in_all(loaded), loaded, prints)
    compile_missing(simulated=True)
    console = plain_console(stderr=True)
    from robotctl.workbench.campaign.boundary import batches  # noqa: PLC0415
    from robotctl.workbench.campaign.engine import WorkersLost, drive, refusals  # noqa: PLC0415

    ctrl_c = CtrlC()
    try:
        with _workers(scheduler, count, files, loaded.buses) as chosen:
            if not (place / HEAD).exists():
                with _trials(console, head.runs) as tell_trial:
                    refused = refusals(runs, chosen, ROBOTCTL, loaded.wall_seconds, tell_trial)
                if refused:
                    raise ConfigError("\n".join(refused))
            with (
                ResultFolder(place, head) as kept,
                _progress(console, head, len(kept.done)) as show,
            ):

                def tell(result: Result) -> None:
                    ctrl_c.check()
                    show(result)

                in_turn = batches(loaded, kept.passes)
                drive(in_turn, kept, chosen, ROBOTCTL, loaded.wall_seconds, tell)
            for worker, reason in chosen.dismissed.items():
                console.print(f"worker {worker} was let go: {reason}", soft_wrap=True)
        summary = _shown(place)
        plain_console().print(f"\npage: {place / PAGE}", soft_wrap=True)
        if corpus is not None and summary.failures:
            with _workers("", count, ()) as chosen:
                keep_failures(loaded, summary, corpus, chosen, plain_console())
    except (KeyboardInterrupt, WorkersLost) as error:
        if not (place / HEAD).exists():
            raise
        summary = _shown(place)
        left = head.runs - len(summary.judged) + len(summary.without_result)
        console.print(
            f"\n{left} of {head.runs} runs are left; to go on:\n  {command_of(sys.argv[1:])}",
            soft_wrap=True,
        )
        if isinstance(error, WorkersLost):
            console.print(str(error), soft_wrap=True)
            sys.exit(FAILED)
        sys.exit(INTERRUPTED)
    return not (summary.failures or summary.without_result)


def _workers(
    scheduler: str, count: int, files: Sequence[Path], buses: Sequence[str] = ()
) -> AbstractContextManager[Workers]:
    """Return the workers of a scheduler, or of this computer, with `buses` in real time."""
    from robotctl.workbench.campaign.engine import local_workers  # noqa: PLC0415

    if not scheduler:
        return local_workers(len(buses) or count or len(os.sched_getaffinity(0)), buses)
    from robotctl.workbench.campaign.cluster import cluster_workers  # noqa: PLC0415 - an extra

    return cluster_workers(scheduler, files)


def _shown(place: Path) -> Summary:
    """Print what the results of a folder show, write its page and table; return the summary."""
    from robotctl.cli.campaign.summary_view import page_of, print_summary  # noqa: PLC0415
    from robotctl.workbench.campaign.parquet import write_parquet  # noqa: PLC0415
    from robotctl.workbench.campaign.results import PAGE, read_folder  # noqa: PLC0415
    from robotctl.workbench.campaign.statistics import summarise  # noqa: PLC0415

    head, results = read_folder(place)
    summary = summarise(head, results)
    print_summary(summary, plain_console())
    write_file(place / PAGE, lambda path: path.write_text(page_of(summary), encoding="utf-8"))
    try:
        write_parquet(place, head, results)
    except ConfigError as error:
        plain_console(stderr=True).print(str(error), soft_wrap=True)
    return summary


def _option_problem(words: Sequence[str]) -> str:
    """Return what is wrong with options of `robotctl sim`; empty: nothing."""
    from robotctl.cli.commands import load  # noqa: PLC0415 - it imports this

    try:
        load("sim").make_context("robotctl sim", [*words])
    except TyperException as error:
        return error.format_message()
    except ConfigError as error:
        return str(error)
    return ""


@contextmanager
def _trials(console: Console, runs: int) -> Iterator[Callable[[int, int], None]]:
    """Show how many kinds of runs were tried; told how many, and of how many."""
    told_s = time.monotonic()
    words = f"trying one of each kind of {counted(runs, 'run')}"
    console.print(words)
    with console.status(words) as status:

        def tell(tried: int, kinds: int) -> None:
            nonlocal told_s
            text = f"{tried} of {counted(kinds, 'kind')} tried"
            status.update(text)
            if not console.is_terminal and time.monotonic() - told_s > _LINE_S:
                told_s = time.monotonic()
                console.print(text)

        yield tell


@contextmanager
def _progress(console: Console, head: Head, done: int) -> Iterator[Tell]:
    """Show how far a campaign is, and when it will be over; told of each result."""
    from rich.progress import (  # noqa: PLC0415 - help is quick
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    told_s = [time.monotonic()]
    counts = {"passed": 0, "failed": 0, "without result": 0}
    names = {True: "passed", False: "failed", None: "without result"}
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    if done:
        console.print(f"{done} of {head.runs} runs have a result already", soft_wrap=True)
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(head.name, total=head.runs - done)

        def tell(result: Result) -> None:
            counts[names[head.judge(result).passed]] += 1
            words = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
            bar.update(task, advance=1, description=f"{head.name}: {words}")
            at = bar.tasks[task]
            if not console.is_terminal and time.monotonic() - told_s[0] > _LINE_S:
                told_s[0] = time.monotonic()
                left = f", {at.time_remaining:.0f} s left" if at.time_remaining else ""
                console.print(f"{at.completed:.0f} of {at.total:.0f}: {words}{left}")

        yield tell
