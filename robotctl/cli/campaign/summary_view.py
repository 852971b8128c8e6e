"""Summary of a campaign, as text for a terminal and as one page for a browser."""

from __future__ import annotations

import html
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from robotctl.cli.html_page import document
from robotctl.words import counted
from robotctl.workbench.campaign.statistics import SURE, Distribution, Effect, Judged, Summary

_TEXT_RUNS: Final = 5
_PAGE_RUNS: Final = 200
"""Runs that are shown of each list."""
_BARS: Final = 24
_WIDTH, _HEIGHT = 240, 36
"""Size of a histogram [px]."""
_QUANTILES: Final = (0.0, 0.05, 0.5, 0.95, 1.0)
_QUANTILE_NAMES: Final = ("least", "5 %", "median", "95 %", "most")


def print_summary(summary: Summary, console: Console) -> None:
    """Print what a campaign shows."""
    console.print(f"{summary.head.name}: {_progress(summary)}", soft_wrap=True)
    console.print(f"passed: {summary.rate}", soft_wrap=True)
    for words in _criteria(summary):
        console.print(words, soft_wrap=True)
    if summary.distributions:
        table = grid("Distributions", *_distribution_names(summary))
        for each in summary.distributions:
            table.add_row(*_distribution_cells(each, 3))
        console.print(table)
    sure, words = _sure(summary)
    if sure:
        table = grid("What matters", "factor", "of", "by value", "p")
        for effect in sure:
            table.add_row(*_effect_cells(effect))
        console.print(table)
    if words:
        console.print(words, soft_wrap=True)
    for title, entries in _lists(summary):
        _print_runs(title, entries, console)


def page_of(summary: Summary) -> str:
    """Return the page of a campaign."""
    rate = summary.rate
    parts = [
        f"<p>{html.escape(_progress(summary))}</p>",
        f"<p>Passed: <b>{html.escape(str(rate))}</b></p>{_bar(*rate.interval, rate.share)}",
        *(f"<p>{html.escape(words)}</p>" for words in _criteria(summary)),
    ]
    if summary.distributions:
        rows = [
            (_escaped(*_distribution_cells(each)), _histogram(each))
            for each in summary.distributions
        ]
        head = (*_distribution_names(summary), "histogram")
        parts.append(f"<h2>Distributions</h2>{_table(head, ((*a, b) for a, b in rows))}")
    sure, words = _sure(summary)
    parts.append(f"<h2>What matters</h2><p>{html.escape(words)}</p>")
    if sure:
        cells = (_escaped(*_effect_cells(each)) for each in sure)
        parts.append(_table(("factor", "of", "by value", "p"), cells))
    for title, entries in _lists(summary):
        lines = [
            (*_escaped(name), f"{html.escape(why)}<br><code>{html.escape(command)}</code>")
            for name, why, command in entries[:_PAGE_RUNS]
        ]
        more = f"<p>and {len(entries) - _PAGE_RUNS} more</p>" if len(entries) > _PAGE_RUNS else ""
        parts.append(f"<h2>{html.escape(title)}</h2>{_table(('run', ''), lines)}{more}")
    return document(summary.head.name, parts)


def _progress(summary: Summary) -> str:
    """Return how many runs there are, and of what."""
    done = len(summary.judged) - len(summary.without_result)
    lacking = len(summary.without_result)
    text = f"{counted(summary.head.runs, 'run')}, {done} with a result"
    if lacking:
        text += f", {lacking} without"
    if left := summary.head.runs - len(summary.judged):
        text += f", {left} not driven yet"
    return f"{text}; robotctl {summary.head.version}, sources {summary.head.sources[:12]}"


def grid(title: str, *names: str) -> Table:
    """Return an empty table for a terminal, whose long words are folded, not cut."""
    table = Table(
        title=f"\n{title}",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for name in names:
        table.add_column(name, overflow="fold")
    return table


def _criteria(summary: Summary) -> Iterator[str]:
    """Yield what a run must fulfil to pass, and how many runs of each case do."""
    head = summary.head
    if summary.case_rates.keys() - head.case_criteria.keys() or not summary.case_rates:
        yield f"a run passes with: {'; '.join(head.criteria)}"
    for case, rate in summary.case_rates.items():
        own = head.case_criteria.get(case)
        yield f"{case}: {rate}" + (f"; passes with: {'; '.join(own)}" if own else "")


def _distribution_names(summary: Summary) -> tuple[str, ...]:
    """Return the names of the columns of distributions."""
    case = ("case",) if summary.case_rates else ()
    return (*case, "field", "runs", *_QUANTILE_NAMES)


def _distribution_cells(each: Distribution, figures: int = 4) -> tuple[str, ...]:
    quantiles = (f"{each.quantile(share):.{figures}g}" for share in _QUANTILES)
    case = (each.case,) if each.case else ()
    return (*case, each.field, str(len(each.values)), *quantiles)


def _sure(summary: Summary) -> tuple[list[Effect], str]:
    """Return the effects that are hardly chance, and a sentence on all that were looked for."""
    if not summary.effects:
        return [], "Nothing but the seed differs between the runs."
    sure = [each for each in summary.effects if each.p < SURE]
    looked = f"{counted(len(summary.effects), 'effect')} looked for"
    if not sure:
        return [], f"{looked}, none found: every difference may be chance (p < {SURE:g} is sought)."
    return sure, f"{looked}; p is adjusted for that. Medians, and for passing the counts."


def _effect_cells(effect: Effect) -> tuple[str, str, str, str]:
    """Return an effect as cells of a table."""
    levels = ", ".join(f"{value}: {shown}" for value, shown in effect.levels)
    return effect.factor, effect.of or "passing", levels, f"{effect.p:.2g}"


def _lists(summary: Summary) -> Iterator[tuple[str, list[tuple[str, str, str]]]]:
    """Yield lists of runs with their titles: number, why, and command of each run."""
    for title, judged in (
        ("Failures", summary.failures),
        ("Without a result", summary.without_result),
    ):
        if judged:
            yield f"{title}: {len(judged)}", [*map(_entry, judged)]
    if summary.worst:
        yield (
            "Worst runs",
            [
                (f"run {each.number}", f"worst {field}", each.command)
                for field, each in summary.worst
            ],
        )


def _entry(judged: Judged) -> tuple[str, str, str]:
    return f"run {judged.result.number}", "; ".join(judged.verdict.why), judged.result.command


def _print_runs(title: str, entries: Sequence[tuple[str, str, str]], console: Console) -> None:
    """Print some of a list of runs."""
    console.print(f"\n{title}", soft_wrap=True)
    for name, why, command in entries[:_TEXT_RUNS]:
        console.print(f"  {name}: {why}\n    {command}", soft_wrap=True)
    if len(entries) > _TEXT_RUNS:
        console.print(f"  and {len(entries) - _TEXT_RUNS} more, see the page", soft_wrap=True)


def _escaped(*cells: str) -> tuple[str, ...]:
    return tuple(map(html.escape, cells))


def _table(names: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of cells that are HTML already."""
    head = "".join(f"<th>{name}</th>" for name in names)
    lines = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{lines}</table>"


def _bar(low: float, high: float, share: float) -> str:
    """Return an interval of shares as a picture."""
    if share != share:  # noqa: PLR0124 - nan
        return ""
    width = 4 * _WIDTH
    return (
        f'<svg width="{width}" height="14" role="img" aria-label="interval of the pass rate">'
        f'<rect width="{width}" height="14" fill="#8884"/>'
        f'<rect x="{low * width:.1f}" width="{(high - low) * width:.1f}" height="14" '
        'fill="#4a90d9" opacity="0.6"/>'
        f'<rect x="{share * width - 1:.1f}" width="2" height="14" fill="currentColor"/></svg>'
    )


def _histogram(each: Distribution) -> str:
    """Return the histogram of a distribution as a picture."""
    counts, _ = np.histogram(each.values, bins=_BARS)
    width, most = _WIDTH / _BARS, max(1, int(counts.max()))
    bars = "".join(
        f'<rect x="{index * width:.1f}" y="{_HEIGHT * (1 - count / most):.1f}" '
        f'width="{width - 1:.1f}" height="{_HEIGHT * count / most:.1f}"/>'
        for index, count in enumerate(counts)
        if count
    )
    return (
        f'<svg width="{_WIDTH}" height="{_HEIGHT}" fill="#4a90d9" role="img" '
        f'aria-label="histogram of {html.escape(each.field)}">{bars}</svg>'
    )
