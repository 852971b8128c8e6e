"""Several runs of `robotctl localise` as one table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from robotctl.words import counted


def seeds_table(reports: Sequence[dict[str, Any]]) -> Table:
    """Return a table with a line for each run, and the median of all; `-`: unknown."""
    table = Table(
        title=f"{counted(len(reports), 'run')}: place known at the end of "
        f"{sum(not each['lost'] for each in reports)}",
        title_justify="left",
        caption="m, rad and s; shares in % of the estimates",
        caption_justify="left",
        box=None,
        collapse_padding=True,
        pad_edge=False,
    )
    for heading in ("seed", "rms", "most", "heading", "after", "localised", "wrong", "on map"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("end", no_wrap=True)
    rows = [_figures(each) for each in reports]
    for each, row in zip(reports, rows, strict=True):
        end = "lost" if each["lost"] else "known"
        table.add_row(str(each["seed"]), *_texts(row), end)
    table.add_section()
    known = [[value for value in column if value is not None] for column in zip(*rows, strict=True)]
    medians = [float(np.median(column)) if column else None for column in known]
    table.add_row("median", *_texts(medians), "")
    return table


_FORMATS = (".3f", ".3f", ".4f", ".1f", ".1%", ".1%", ".0%")


def _figures(report: dict[str, Any]) -> list[float | None]:
    """Return the figures of a run in the order of the columns."""
    shares = report["shares"]
    return [
        report["ape"]["rmse_m"],
        report["ape"]["max_m"],
        report["heading_rmse_rad"],
        report["localised_after_s"],
        shares["localised"],
        shares["confidently_wrong"],
        report["echoes_on_map"],
    ]


def _texts(row: Sequence[float | None]) -> list[str]:
    """Return figures as text."""
    return [
        "-" if value is None else format(value, form)
        for value, form in zip(row, _FORMATS, strict=True)
    ]
