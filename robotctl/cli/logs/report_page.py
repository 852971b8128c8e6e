"""The page about a run: one file of HTML that loads nothing; needs the extra `plot`."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Mapping
from typing import Any, Final

from robotctl.cli.html_page import document
from robotctl.cli.logs.series_plot import draw
from robotctl.workbench.logs.run_report import RunReport

_LINES: Final[Mapping[str, Mapping[str, Any]]] = {
    "odometry": {"color": "0.6", "linewidth": 1.0},
    "believed": {"color": "tab:blue", "linewidth": 1.6},
    "truth": {"color": "tab:orange", "linewidth": 1.2, "linestyle": "--"},
}
"""Looks of the paths."""


def page_of(report: RunReport) -> str:
    """Return the page."""
    parts = [f"<p>Note: {html.escape(note)}</p>" for note in report.notes]
    if report.score:
        figures = "".join(
            f"<div><span>{html.escape(name)}</span><b>{html.escape(value)}</b></div>"
            for name, value in report.score.items()
        )
        parts.append(f'<h2>Score</h2><div class="score">{figures}</div>')
    parts.append(f"<h2>Path</h2>{_picture(_map_figure(report), 'Map and paths of the robot')}")
    parts.append(f"<h2>Over time</h2>{_picture(_plots(report), 'Speeds, supply, lag and states')}")
    states = ((time_s, "", (state, reason)) for time_s, state, reason in report.reasons)
    parts.append(f"<h2>States</h2>{_table(('time, s', 'state', 'reason'), states)}")
    notices = ((each.time_s, each.level, (each.level, each.text)) for each in report.notices)
    parts.append(f"<h2>Notices</h2>{_table(('time, s', 'level', 'text'), notices)}")
    return document(report.name, parts)


def _table(names: Iterable[str], rows: Iterable[tuple[float, str, tuple[str, ...]]]) -> str:
    """Return a table of lines with their times [s], each of a class."""
    head = "".join(f"<th>{name}</th>" for name in names)
    lines = "".join(
        f'<tr class="{kind}"><td class="time">{time_s:.2f}</td>'
        f"{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>"
        for time_s, kind, cells in rows
    )
    return f"<table><tr>{head}</tr>{lines}</table>"


def _picture(figure: Any, words: str) -> str:
    """Return a figure as an image within the page; `words` say what is on it."""
    file = io.BytesIO()
    figure.savefig(file, format="png")
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(words)}" src="data:image/png;base64,{data}">'


def _map_figure(report: RunReport) -> Any:
    """Return the map with the robot's paths on it."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    from matplotlib.transforms import Affine2D  # noqa: PLC0415

    figure = Figure(figsize=(11.0, 7.0), dpi=110, layout="constrained")
    axes = figure.subplots()
    if report.map is not None:
        corner = report.map.corner
        turned = Affine2D().rotate(corner.theta_rad).translate(corner.x_m, corner.y_m)
        axes.imshow(
            report.map.greys,
            cmap="gray",
            vmin=0,
            vmax=255,
            origin="lower",
            extent=(0.0, report.map.width_m, 0.0, report.map.height_m),
            transform=turned + axes.transData,
        )
        ends = [
            corner.apply(x, y) for x in (0, report.map.width_m) for y in (0, report.map.height_m)
        ]
        axes.update_datalim(ends)
        axes.autoscale_view()
    shown = [name for name in report.paths if name != "odometry"] or [*report.paths]
    for name in shown:
        x_m, y_m = report.paths[name].poses[:, :2].T
        axes.plot(x_m, y_m, label=name, **_LINES[name])
        axes.plot(x_m[0], y_m[0], "o", color=_LINES[name]["color"])
        axes.plot(x_m[-1], y_m[-1], "s", color=_LINES[name]["color"])
    axes.set_aspect("equal")
    axes.set_xlabel("x, m (circle: start, square: end)")
    axes.set_ylabel("y, m")
    axes.legend(loc="upper right", fontsize="small")
    return figure


def _plots(report: RunReport) -> Any:
    """Return the fields over time, with the states behind them."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    units = {series.unit for series in report.selection.series}
    figure = Figure(figsize=(11.0, 1.0 + 2.0 * len(units)), dpi=110, layout="constrained")
    draw(figure, report.selection, "")
    return figure
