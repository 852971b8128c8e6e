"""A characterisation as a picture: errors with the mixture, echoes against incidence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtr  # type: ignore[import-untyped]

from robotctl.cli.picture import drawing
from robotctl.estimation.ranging.range_mixture import densities
from robotctl.workbench.sensors.characterise import Characterisation

_INNER_SIGMAS = 6.0
_BIN_DEG = 2.5


def save_plot(result: Characterisation, file: Path) -> None:
    """Draw errors near and far, and the share of readings with an echo."""
    with drawing(file, 13.0, 4.2) as figure:
        near, far, echoes = figure.subplots(1, 3)
        fit = result.fit
        sigma_m = float(fit.ranges.mixture.sigma_at(np.array(fit.ranges.typical_m)))
        offset_m = fit.ranges.mixture.offset_m
        reach_m = 1.1 * float(fit.measured_m[np.isfinite(fit.measured_m)].max())
        inner_m = _INNER_SIGMAS * sigma_m
        _errors(near, result, np.linspace(offset_m - inner_m, offset_m + inner_m, 81))
        _errors(far, result, np.linspace(-reach_m, reach_m, 121))
        far.set_yscale("log")
        near.set_title("errors of ranges")
        far.set_title("all of them, logarithmic")
        near.legend()
        _echoes(echoes, result)
        figure.suptitle(f"{result.config.robot.name}: {result.source.sensor}")


def _errors(panel: Any, result: Characterisation, edges: np.ndarray[Any, Any]) -> None:
    """Draw the errors of hits, short and random readings, and the mixture's share in each bin."""
    fit = result.fit
    both = fit.fitted & np.isfinite(fit.expected_m) & np.isfinite(fit.measured_m)
    m, z = fit.expected_m[both], fit.measured_m[both]
    panel.hist(z - m, edges, color="tab:blue", alpha=0.5, label="readings")
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    mixture, range_m = fit.ranges.mixture, fit.greatest_m.value
    some = m[:: max(1, len(m) // 1000), np.newaxis]
    at = some + middle
    _, short = densities(mixture, some, np.maximum(at, 0.0), range_m)
    garbage = (short + mixture.random / range_m) * ((at >= 0.0) & (at < range_m)) * width
    # Hits are far narrower than a bin may be.
    below = ndtr((edges - mixture.offset_m) / mixture.sigma_at(some))
    expected = (mixture.hit * np.diff(below, axis=1) + garbage).mean(axis=0) * len(m)
    panel.plot(middle, expected, "k-", label="fitted mixture")
    panel.set_ylim(bottom=0.3)
    panel.set_xlabel("measured - expected, m")
    panel.set_ylabel("readings")
    panel.grid(visible=True, alpha=0.3)


def _echoes(panel: Any, result: Characterisation) -> None:
    """Draw the share of readings with an echo, with its 95 % interval (Wilson), and the limit."""
    fit = result.fit
    degrees = np.degrees(fit.incidences_rad)
    edges = np.arange(0.0, degrees.max() + _BIN_DEG, _BIN_DEG)
    count, _ = np.histogram(degrees, edges)
    heard, _ = np.histogram(degrees[fit.heard], edges)
    used = count > 0
    n, middle = count[used], (0.5 * (edges[1:] + edges[:-1]))[used]
    share = heard[used] / n
    centre = (share + 1.92 / n) / (1.0 + 3.84 / n)
    half = 1.96 * np.sqrt(share * (1.0 - share) / n + 0.96 / n**2) / (1.0 + 3.84 / n)
    panel.errorbar(middle, centre, half, fmt="none", ecolor="0.6")
    panel.plot(middle, share, "o", color="tab:blue", markersize=3, label="share with an echo")
    limit = fit.incidence.limit
    if not limit.why_not:
        panel.axvspan(math.degrees(limit.low), math.degrees(limit.high), color="tab:red", alpha=0.3)
        label = f"limit {math.degrees(limit.value):.1f}°"
        panel.axvline(math.degrees(limit.value), color="tab:red", linewidth=1.0, label=label)
    panel.set_ylim(-0.02, 1.05)
    panel.set_xlabel("least incidence, °")
    panel.set_title("echoes")
    panel.grid(visible=True, alpha=0.3)
    panel.legend(loc="lower left")
