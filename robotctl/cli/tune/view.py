"""The result of a tuning as tables for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rich.table import Table

from robotctl.control.identification.step_metrics import StepMetrics
from robotctl.workbench.tuning.patch import KEYS
from robotctl.workbench.tuning.tune import BAND, StepResponse, TuneResult


def response_table(result: TuneResult) -> Table:
    """Return the step responses before and after."""
    first = result.before[0].step
    table = Table(
        title=(
            f"{result.config.robot.name}: true speed after a step from 0 to {first.wanted_m_s:g} "
            f"m/s through the limiter"
        ),
        title_justify="left",
    )
    table.add_column("")
    for when, responses in (("before", result.before), ("after", result.after)):
        for response in responses:
            table.add_column(f"{when}, {response.charge:.0%}", justify="right")
    responses = (*result.before, *result.after)
    _row(table, "rise time 10 to 90 %", responses, lambda m: _seconds(m.rise_s))
    _row(table, "overshoot", responses, lambda m: f"{m.overshoot:.1%}")
    _row(table, "settling time", responses, lambda m: _seconds(m.settling_s))
    _row(table, "steady-state error", responses, lambda m: f"{m.steady_state_error:+.2%}")
    table.caption = f"heading: battery charge; settling into ±{BAND:.0%} of the step"
    return table


def _row(
    table: Table,
    name: str,
    responses: Sequence[StepResponse],
    words: Callable[[StepMetrics], str],
) -> None:
    table.add_row(name, *(words(response.metrics) for response in responses))


def _seconds(value: float | None) -> str:
    return "never" if value is None else f"{value:.3f} s"


def wheel_table(result: TuneResult) -> Table:
    """Return what was identified of each wheel, and its gains before and after."""
    table = Table(title="wheels", title_justify="left")
    table.add_column("")
    for name in result.fits:
        table.add_column(name, justify="right")
    fits = result.fits.values()
    table.add_row("gain K, rad/s per V", *(f"{fit.model.gain:.3f}" for fit in fits))
    table.add_row("time constant", *(f"{fit.model.time_constant_s:.4f} s" for fit in fits))
    table.add_row("dead time", *(f"{fit.model.delay_s:.4f} s" for fit in fits))
    table.add_row("feed-forward misses", *(f"{fit.feedforward.rms_error_v:.3f} V" for fit in fits))
    points = [fit.ultimate for fit in fits if fit.ultimate is not None]
    if points:
        table.add_row("ultimate gain Ku, V s/rad", *(f"{point.gain:.2f}" for point in points))
        table.add_row("ultimate period Tu", *(f"{point.period_s:.3f} s" for point in points))
    table.add_section()
    for key in KEYS:
        table.add_row(
            key,
            *(
                f"{getattr(getattr(result.config.control, name), key):g} → {getattr(gains, key):g}"
                for name, gains in result.gains.items()
            ),
        )
    return table
