"""The corpus of `robotctl campaign`: failures made small, kept, and run again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console

from robotctl.cli.main import main
from robotctl.errors import ConfigError
from robotctl.words import counted
from robotctl.workbench.campaign.alone import Program

if TYPE_CHECKING:
    from robotctl.workbench.campaign.alone import Ending
    from robotctl.workbench.campaign.campaign_file import Campaign
    from robotctl.workbench.campaign.engine import Workers
    from robotctl.workbench.campaign.statistics import Judged, Summary

ROBOTCTL: Final = Program(main, warm="robotctl.cli.campaign.warm")
"""The program of each run."""
_MOST: Final = 20
"""Kinds of failures that are made small at a time."""


def keep_failures(
    campaign: Campaign, summary: Summary, corpus: Path, workers: Workers, console: Console
) -> None:
    """Make one failure of each kind small and keep it, unless it is there already."""
    from robotctl.workbench.campaign.minimise import alike  # noqa: PLC0415 - numpy

    groups = alike(summary.failures, summary.head)[:_MOST]
    names = [f"{summary.head.name}-{each[0].result.number}" for each in groups]
    futures = {
        workers.executor.submit(_small, campaign, summary, group, corpus / f"{name}.toml", workers)
        for group, name in zip(groups, names, strict=True)
        if not (corpus / f"{name}.toml").exists()
    }
    if futures:
        kinds = counted(len(futures), "kind") + " of failures"
        console.print(f"making {kinds} small, for {corpus}", soft_wrap=True)
    for future in as_completed(futures):
        console.print(future.result(), soft_wrap=True)


def _small(
    campaign: Campaign, summary: Summary, group: Sequence[Judged], file: Path, workers: Workers
) -> str:
    """Make the first of some failures small and keep it; return what became of it."""
    from robotctl.workbench.campaign.minimise import (  # noqa: PLC0415
        case_of,
        keep,
        minimised,
        shown_case,
    )

    result, why = group[0].result, "; ".join(group[0].verdict.why)
    before = case_of(campaign, result)

    def run(words: Sequence[str]) -> Ending:
        return workers.run(ROBOTCTL, words, campaign.wall_seconds)

    after, runs = minimised(before, summary.head.conditions_of(result), result, run)
    comment = (
        f"Made small from run {result.number} of {summary.head.name}:\n{why}\n{result.command}"
    )
    keep(file.parent, file.stem, after, summary.head.criteria_of(result.factors), comment)
    others = f" and {counted(len(group) - 1, 'other')} like it" if len(group) > 1 else ""
    return (
        f"run {result.number}{others}: {why}\n  from {shown_case(before)}\n"
        f"  to {shown_case(after)} in {counted(runs, 'run')}: {file}"
    )


def run_again(
    corpus: Path, workers: Workers, check: Callable[[Sequence[str]], str], console: Console
) -> bool:
    """Run all of a corpus; return whether all pass.

    Raises
    ------
    ConfigError
        If it has no campaign files, or one of them is wrong.
    """
    from robotctl.workbench.campaign.checked_file import load_campaign  # noqa: PLC0415 - numpy
    from robotctl.workbench.campaign.plan import plan  # noqa: PLC0415
    from robotctl.workbench.campaign.results import head_of, result_of  # noqa: PLC0415

    files = sorted(corpus.glob("*.toml"))
    if not files:
        raise ConfigError(f"{corpus}: no campaign files there; --corpus {corpus} makes some")
    futures = {}
    for file in files:
        loaded = load_campaign(file, check)
        if loaded.buses:
            raise ConfigError(f"{file}: buses: not allowed in a corpus, which is run in lockstep")
        runs = plan(loaded)
        head = head_of(file.stem, len(runs), loaded, ("", ""))
        for run in runs:
            start = partial(workers.run, ROBOTCTL, run.words, loaded.wall_seconds)
            futures[workers.executor.submit(start)] = (file, run, head)
    passed = 0
    for future in as_completed(futures):
        file, run, head = futures[future]
        ending = future.result()
        verdict = head.judge(result_of(run, ending.report, ending.reason))
        passed += verdict.passed is True
        words = {True: "passes", False: "fails", None: "no result"}[verdict.passed]
        why = f": {'; '.join(verdict.why)}\n    {run.command}" if verdict.why else ""
        console.print(f"{file.stem}: {words}{why}", soft_wrap=True)
    console.print(f"{passed} of {len(futures)} pass", soft_wrap=True)
    return passed == len(futures)
