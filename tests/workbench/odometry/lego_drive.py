"""A made-up log in the form of the LEGO robot's, of one that is not as it should be."""

import math
from pathlib import Path

import numpy as np

from robotctl.model.drives.motion import arc
from robotctl.model.geometry.se2 import SE2

TICK_M, TRACK_WIDTH_M = 0.349e-3, 0.173
NOMINAL = (
    "drive.track_width_m=0.173",
    f"drive.wheel_radius_m={TICK_M * 360 / math.tau!r}",
    "drive.counts_per_revolution=360",
)
"""Settings that make `diff_drive` this robot."""


def write_lego(path: Path, scale: float, width: float, seed: int = 1, metres: float = 12.0) -> Path:
    """Write a drive whose wheels are larger by `scale`, and the track wider by `width`."""
    rng = np.random.default_rng(seed)
    pose, lines, counts = SE2(0.5, 0.5, 0.3), [], np.array([1000.0, 5000.0])
    bend = 0.0
    for step in range(round(metres / 0.02)):
        if step % 40 == 0:
            bend = float(rng.uniform(-2.0, 2.0))
        t_ms = 100 * step
        lines.append(f"M {t_ms} {round(counts[0])} 0 0 0 {round(counts[1])} 0 0 0 0 0 0 0")
        if step % 3 == 0:
            x_mm, y_mm = 1000 * np.array([pose.x_m, pose.y_m]) + rng.normal(0.0, 2.0, 2)
            lines.append(f"P {t_ms} {round(x_mm)} {round(y_mm)}")
        d, turn = 0.02, 0.02 * bend
        half = 0.5 * TRACK_WIDTH_M * width * turn
        counts += np.array([d - half, d + half]) / (TICK_M * scale)
        pose = arc(pose, d, turn + float(rng.normal(0.0, 0.001)))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
