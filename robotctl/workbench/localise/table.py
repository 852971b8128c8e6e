"""A filter's estimates as a table: the file of `robotctl localise --csv`."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Final

from robotctl.model.geometry.pose_estimate import PoseEstimate, upper_triangle
from robotctl.model.geometry.se2 import SE2
from robotctl.workbench.localise.report import Run, is_wrong

COLUMNS: Final = (
    "t_s", "x_m", "y_m", "theta_rad", "status",
    "var_x_m2", "cov_x_y_m2", "cov_x_theta_m_rad", "var_y_m2", "cov_y_theta_m_rad",
    "var_theta_rad2", "reference_x_m", "reference_y_m", "reference_theta_rad", "error_m",
    "heading_error_rad", "confidently_wrong", "echoes_on_map",
)  # fmt: skip
"""Covariances are those of x, y and theta in `world`; unknown values are empty."""


def write_table(path: Path, run: Run) -> None:
    """Write a line for each estimate; see `COLUMNS`.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    with path.open("w", encoding="ascii", newline="") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for estimate, reference, share in zip(
            run.estimates, run.references, run.echo_shares, strict=True
        ):
            table.writerow(_row(run, estimate, reference, share))


def _row(
    run: Run, estimate: PoseEstimate, reference: SE2 | None, share: float | None
) -> list[str | int]:
    """Return a line of the table."""
    whole, rest = divmod(estimate.stamp_ns, 1_000_000_000)
    pose = estimate.pose
    row: list[str | int] = [
        f"{whole}.{rest:09d}" if whole >= 0 else f"{1e-9 * estimate.stamp_ns:.9f}",
        f"{pose.x_m:.7f}",
        f"{pose.y_m:.7f}",
        f"{math.remainder(pose.theta_rad, math.tau):.9f}",
        estimate.status.name.lower(),
        *(f"{value:.6g}" for value in upper_triangle(estimate.covariance)),
    ]
    if reference is None:
        row += [""] * 6
    else:
        heading = f"{reference.theta_rad:.9f}" if run.has_heading else ""
        turned = math.remainder(pose.theta_rad - reference.theta_rad, math.tau)
        row += [
            f"{reference.x_m:.7f}",
            f"{reference.y_m:.7f}",
            heading,
            f"{math.hypot(pose.x_m - reference.x_m, pose.y_m - reference.y_m):.6f}",
            f"{turned:.6f}" if run.has_heading else "",
            int(is_wrong(estimate, reference, has_heading=run.has_heading)),
        ]
    row.append("" if share is None else f"{share:.4f}")
    return row
