"""`robotctl plot`: fields of a recording over time, as a picture or as text."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from robotctl.cli.console import plain_console
from robotctl.cli.files import check_files, write_file
from robotctl.cli.progress import progress_bar
from robotctl.errors import ConfigError
from robotctl.words import counted

if TYPE_CHECKING:
    from robotctl.workbench.logs.series import Selection, Series


def plot(
    run: Annotated[
        Path,
        typer.Argument(
            help="Folder of --record, a robot-*.mcap of it, or a record: fault-*.rec, a dump."
        ),
    ],
    fields: Annotated[
        list[str],
        typer.Argument(metavar="TOPIC.FIELD...", help="Such as control.v_m_s or control.duty."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Plot to a .png, .svg or .pdf; default: a window, or a summary."),
    ] = None,
) -> None:
    """Plot fields of a recording over time, with the robot's states, restarts and gaps.

    Topics and fields are those of docs/logs.md; a wrong name is answered by the nearest.
    """
    for name in fields:
        if not all(name.partition(".")):
            raise ConfigError(f"{name}: give topic and field, such as control.v_m_s")
    check_files(plot=out, option="--out")
    console = plain_console(stderr=True)
    with progress_bar(console, run.name, "reading") as tell:
        from robotctl.workbench.logs.series import select  # noqa: PLC0415 - loads numpy

        selection = select(run, fields, tell)
    for note in selection.notes:
        console.print(f"note: {note}", soft_wrap=True)
    if out is not None:
        from robotctl.cli.logs.series_plot import save_plot  # noqa: PLC0415 - an extra

        write_file(out, lambda file: save_plot(selection, run.name, file))
        return
    if not _shown(selection, run.name):
        for line in summary(selection):
            print(line)
        console.print("no display found; use `--out FILE.png`", soft_wrap=True)


def _shown(selection: Selection, title: str) -> bool:
    """Show a window, where there is a display and what it takes; return whether one was shown."""
    has_display = sys.platform != "linux" or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    if not has_display or importlib.util.find_spec("matplotlib") is None:
        return False
    from robotctl.cli.logs.series_plot import show  # noqa: PLC0415 - an extra

    return show(selection, title)


def summary(selection: Selection) -> Iterator[str]:
    """Yield what there is to say of a selection, line by line."""
    for series in selection.series:
        yield f"{series.name}: {_figures(series)}"
        for begin_s, end_s in series.gaps:
            yield f"  no messages from {begin_s:.2f} to {end_s:.2f} s"
    if selection.stretches:
        states = (
            f"{each.state.name.lower().replace('_', ' ')} {each.begin_s:.2f} to {each.end_s:.2f} s"
            for each in selection.stretches
        )
        yield f"state: {', '.join(states)}"
    for restart_s in selection.restarts_s:
        yield f"control restarted at {restart_s:.2f} s"


def _figures(series: Series) -> str:
    """Return the figures of a series as text."""
    import numpy as np  # noqa: PLC0415 - heavy

    finite = series.values[np.isfinite(series.values)]
    infinite = int(np.isinf(series.values).sum())
    missing = series.messages - len(finite) - infinite
    unit = f" {series.unit}" if series.unit else ""
    values = counted(len(finite), "value")
    parts = [values]
    if len(finite):
        parts = [
            f"{values} from {series.time_s[0]:.2f} to {series.time_s[-1]:.2f} s",
            f"{finite.min():.6g} to {finite.max():.6g}{unit}, mean {finite.mean():.6g}{unit}",
        ]
    parts += [f"{infinite} infinite"] if infinite else []
    parts += [f"{missing} missing"] if missing else []
    return "; ".join(parts)
