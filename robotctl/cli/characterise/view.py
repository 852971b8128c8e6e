"""A characterisation as tables for a terminal."""

from __future__ import annotations

from rich.table import Table

from robotctl.estimation.ranging.fit.range_fit import Fitted
from robotctl.estimation.sensor_names import SONAR
from robotctl.words import counted
from robotctl.workbench.sensors.characterise import Characterisation
from robotctl.workbench.sensors.patch import patch_values

_NOTHING = 1e-6
_ANYTHING = 999.0
_ROWS = {
    "hit": "hit",
    "short": "short",
    "none": "no echo where one is due",
    "random": "random",
    "garbage": "short or random",
    "sigma_m": "sigma_m, m",
    "sigma_per_m": "sigma_per_m",
    "offset_m": "mean error of a hit, m",
    "short_per_m": "rate of short readings, 1/m",
}


def fit_table(result: Characterisation) -> Table:
    """Return what was measured, with the intervals."""
    fit = result.fit
    table = Table(
        title=f"{result.config.robot.name}, {result.source.sensor}: "
        f"{counted(len(fit.fitted), 'reading')}, "
        f"{int(fit.fitted.sum())} of them away from edges and limits",
        title_justify="left",
    )
    table.add_column("", no_wrap=True)
    for heading in ("value", "95 % interval"):
        table.add_column(heading, justify="right")
    values = fit.ranges.values
    for key, words in _ROWS.items():
        _row(table, words, values[key])
    at = f"K of the robust likelihood at {fit.ranges.typical_m:.2g} m"
    _row(table, at, values["robust_k"])
    _row(table, "incidence limit, deg", fit.incidence.limit.in_degrees())
    if result.source.sensor == SONAR:
        _row(table, "greatest range, m", fit.greatest_m)
    return table


def _row(table: Table, words: str, found: Fitted) -> None:
    """Add a value, or that it is undetermined."""
    told = found.high < _ANYTHING
    ends = f"{_number(found.low)} to {_number(found.high)}" if told else ""
    table.add_row(words, "not told" if found.why_not else _number(found.value), ends)


def _number(value: float) -> str:
    """Return a number; what lies at the bound of the fit is 0."""
    return f"{value if abs(value) > _NOTHING else 0.0:.5g}"


def patch_table(result: Characterisation) -> Table:
    """Return what changes for the localiser."""
    table = Table(title="settings for the robot's file", title_justify="left")
    table.add_column("", no_wrap=True)
    for heading in ("before", "after"):
        table.add_column(heading, justify="right")
    for name, changed in patch_values(result).items():
        before = getattr(result.config.localisation, name.removeprefix("localisation."))
        for key, value in changed.items():
            table.add_row(f"{name}.{key}", f"{getattr(before, key):.4g}", f"{value:.4g}")
    return table


def words(result: Characterisation) -> list[str]:
    """Return further remarks."""
    source, fit = result.source, result.fit
    origin = (
        f"poses by {source.poses_by}; room: {source.map_by}; intervals by "
        f"{counted(fit.ranges.stretches, 'stretch', 'stretches')} of the readings"
    )
    within = (
        f"{100 * result.within:.1f} % of the ranges away from edges lie within three of the "
        "present standard deviations, which also allow for particles beside the truth"
    )
    lines = [origin, *source.notes, within, *result.hidden]
    if fit.incidence.fades_rad > 0.0:
        lines.append("echoes fade out with the incidence rather than end; half remain at the limit")
    lines.append(
        "a reading tells the true place from others near it by "
        f"{result.told_before:.2f} nat with the present settings, {result.told_after:.2f} with "
        "the new ones"
    )
    return lines
