"""The error analysis of a camera as a picture; needs the extra `plot`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from robotctl.cli.picture import drawing
from robotctl.workbench.camera.check import CheckResult

_WITHIN = 1.96


def save_plot(result: CheckResult, file: Path) -> None:
    """Draw measured and estimated places, and the errors over the distance."""
    with drawing(file, 11.0, 5.5) as figure:
        floor, graph = figure.subplots(1, 2)
        errors, ground = result.errors, result.points.ground
        factor = _factor(errors.off_m)
        away = factor * (errors.told - ground)
        floor.quiver(
            -ground[:, 1], ground[:, 0], -away[:, 1], away[:, 0],
            angles="xy", scale_units="xy", scale=1.0, color="tab:red", width=0.004,
        )  # fmt: skip
        floor.plot(-ground[:, 1], ground[:, 0], "k+", label="known place")
        foot = result.camera.t_base_camera
        floor.plot(-foot[1], foot[0], "b^", label="camera")
        floor.set_aspect("equal", adjustable="datalim")
        floor.set_xlabel("-y (right), m")
        floor.set_ylabel("x (ahead), m")
        floor.set_title(f"from measured to estimated place, {factor:g} times larger")
        floor.legend(loc="best")
        for k, (name, color) in enumerate((("radial", "tab:red"), ("lateral", "tab:blue"))):
            sigma_mm = 1e3 * np.sqrt(errors.P[:, k, k])
            graph.errorbar(
                errors.range_m + 0.005 * k, 1e3 * errors.off_m[:, k], _WITHIN * sigma_mm,
                fmt="o", color=color, capsize=3, label=f"{name}, 95 % of the noise",
            )  # fmt: skip
        graph.axhline(0.0, color="k", linewidth=0.8)
        graph.set_xlabel("distance, m")
        graph.set_ylabel("estimated minus measured, mm")
        graph.grid(visible=True, alpha=0.3)
        graph.legend(loc="best")


def _factor(off_m: np.ndarray) -> float:
    """Return a round factor that makes errors visible."""
    largest_m = float(np.nanmax(np.abs(off_m), initial=0.0))
    return 10.0 ** max(0, math.floor(math.log10(0.3 / largest_m))) if largest_m > 0.0 else 1.0
