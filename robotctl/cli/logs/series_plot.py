"""Fields of a recording over time as a picture; needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from robotctl.messages.control import SafetyState
from robotctl.workbench.logs.series import Selection, Series

_SHADES: Final = {
    SafetyState.BOOT: "0.85",
    SafetyState.STANDBY: "0.93",
    SafetyState.ARMED: "lightyellow",
    SafetyState.DRIVING: "honeydew",
    SafetyState.FAULT: "mistyrose",
    SafetyState.EMERGENCY_STOP: "lightcoral",
    SafetyState.MOTOR_TEST: "honeydew",
}
_WITHOUT_WINDOWS: Final = frozenset({"agg", "cairo", "pdf", "pgf", "ps", "svg", "template"})
_MANY: Final = 12
"""Maximum names in a legend."""


def save_plot(selection: Selection, title: str, file: Path) -> None:
    """Draw a selection into a file."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    figure = Figure(figsize=_size(selection), dpi=120, layout="constrained")
    draw(figure, selection, title)
    figure.savefig(file)


def show(selection: Selection, title: str) -> bool:
    """Show a selection in a window until it is closed; False if nothing can show one."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    figure = plt.figure(figsize=_size(selection), layout="constrained")
    if plt.get_backend().lower() in _WITHOUT_WINDOWS:
        return False
    draw(figure, selection, title)
    plt.show()
    return True


def _panels(selection: Selection) -> dict[str, list[Series]]:
    """Return the series by unit: one panel for each, in the order in which they were asked for."""
    panels: dict[str, list[Series]] = {}
    for series in selection.series:
        panels.setdefault(series.unit, []).append(series)
    return panels


def _size(selection: Selection) -> tuple[float, float]:
    """Return width and height [inch]."""
    return 11.0, 1.5 + 2.5 * len(_panels(selection))


def draw(figure: Any, selection: Selection, title: str) -> None:
    """Draw all panels, one below the other."""
    panels = _panels(selection)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (unit, lines) in zip(axes, panels.items(), strict=True):
        for series in lines:
            values = np.where(np.isfinite(series.values), series.values, np.nan)
            panel.plot(series.time_s, values, linewidth=1.0, label=series.name)
        _draw_states(panel, selection)
        panel.set_ylabel(unit or "value")
        panel.grid(visible=True, alpha=0.3)
        panel.margins(x=0.01)
        if len(lines) <= _MANY:
            panel.legend(loc="upper right", fontsize="small")
    axes[-1].set_xlabel("time, s")
    _explain_states(figure, selection)
    figure.suptitle(title)


def _draw_states(panel: Any, selection: Selection) -> None:
    """Draw the states of the robot behind the lines; nothing if nothing was logged."""
    for stretch in selection.stretches:
        panel.axvspan(
            stretch.begin_s, stretch.end_s, color=_SHADES[stretch.state], linewidth=0.0, zorder=0
        )
    for restart_s in selection.restarts_s:
        panel.axvline(restart_s, color="tab:purple", linestyle="--", linewidth=1.0)


def _explain_states(figure: Any, selection: Selection) -> None:
    """Say below all panels what the shades mean."""
    from matplotlib.lines import Line2D  # noqa: PLC0415 - an extra
    from matplotlib.patches import Patch  # noqa: PLC0415

    there = dict.fromkeys(stretch.state for stretch in selection.stretches)
    known: list[Any] = [
        Patch(facecolor=_SHADES[state], edgecolor="0.6", label=state.name.lower().replace("_", " "))
        for state in sorted(there)
    ]
    if selection.restarts_s:
        known.append(Line2D([], [], color="tab:purple", linestyle="--", label="control anew"))
    if known:
        figure.legend(handles=known, loc="outside lower center", ncols=len(known), fontsize="small")
