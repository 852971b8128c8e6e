"""`robotctl campaign compare`: two folders of results, paired by kind and seed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.words import counted

_SHOWN = 5
"""Runs that are shown of those that failed only now."""
WORSE_STATUS = 3


def compare(
    before: Annotated[Path, typer.Argument(help="Folder of the results before a change.")],
    after: Annotated[Path, typer.Argument(help="Folder of those after it.")],
) -> None:
    """Compare two campaigns run by run: better, worse, or no difference.

    Runs of the same kind and seed are paired. Status 0: nothing became worse. 3: something did.
    """
    from robotctl.cli.campaign.summary_view import grid  # noqa: PLC0415 - numpy
    from robotctl.workbench.campaign.compare import WORSE  # noqa: PLC0415
    from robotctl.workbench.campaign.compare import compare as compared  # noqa: PLC0415
    from robotctl.workbench.campaign.results import read_folder  # noqa: PLC0415

    first, second = read_folder(before), read_folder(after)
    found = compared(first, second)
    console = plain_console()
    console.print(f"before: {before}, robotctl sources {first[0].sources[:12]}", soft_wrap=True)
    console.print(f"after: {after}, robotctl sources {second[0].sources[:12]}", soft_wrap=True)
    table = grid(
        f"{counted(found.differences[0].pairs, 'pair')}, {found.unpaired} runs without their like",
        "field", "before", "after", "change, 95 %", "+/-", "p", "",
    )  # fmt: skip
    for each in found.differences:
        low, high = each.interval
        table.add_row(
            each.field,
            f"{each.before:.3g}",
            f"{each.after:.3g}",
            f"{low:+.2g}..{high:+.2g}",
            f"{each.more}/{each.less}",
            f"{each.p:.1g}",
            each.verdict,
        )
    console.print(table)
    if found.broken:
        console.print(f"passed before, fail now: {len(found.broken)}", soft_wrap=True)
    for result in found.broken[:_SHOWN]:
        console.print(f"  run {result.number}\n    {result.command}", soft_wrap=True)
    if any(each.verdict == WORSE for each in found.differences):
        sys.exit(WORSE_STATUS)
