"""The step responses of a tuning as a picture; needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path

from robotctl.cli.picture import drawing
from robotctl.workbench.tuning.tune import BAND, StepResponse, TuneResult


def save_plot(result: TuneResult, file: Path) -> None:
    """Draw the responses before and after, one panel for each charge of the battery."""
    with drawing(file, 10.0, 4.5) as figure:
        panels = figure.subplots(1, len(result.before), sharey=True, squeeze=False)[0]
        for panel, before, after in zip(panels, result.before, result.after, strict=True):
            wanted_m_s = before.step.wanted_m_s
            panel.axhspan(
                (1.0 - BAND) * wanted_m_s,
                (1.0 + BAND) * wanted_m_s,
                color="0.9",
                label=f"±{BAND:.0%} of the step",
            )
            reference = after.step
            panel.plot(
                reference.time_s, reference.reference_m_s, "k--", linewidth=1.0, label="reference"
            )
            for name, response in (("before", before), ("after", after)):
                panel.plot(response.step.time_s, response.step.true_m_s, label=name)
            panel.set_title(f"{before.charge:.0%} battery")
            panel.set_xlabel("time since the step, s")
            panel.set_xlim(0.0, max(1.0, *(_busy_s(response) for response in (before, after))))
            panel.grid(visible=True, alpha=0.3)
        panels[0].set_ylabel("true speed, m/s")
        panels[0].legend(loc="lower right")
        figure.suptitle(f"{result.config.robot.name}, method {result.options.method}")


def _busy_s(response: StepResponse) -> float:
    """Return how much of a response there is to see [s]."""
    settling_s = response.metrics.settling_s
    return float(response.step.time_s[-1]) if settling_s is None else 1.3 * settling_s
