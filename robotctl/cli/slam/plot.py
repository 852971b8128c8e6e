"""Trajectory and map of SLAM as a picture; needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robotctl.cli.picture import drawing, see_from_above
from robotctl.model.geometry.points import align, moved
from robotctl.workbench.slam.result import SlamResult


def save_plot(result: SlamResult, file: Path) -> None:
    """Draw trajectory and landmarks with 95 % ellipses; a reference is turned onto them."""
    with drawing(file, 9.0, 9.0) as figure:
        axes = figure.subplots()
        path = result.estimate.trajectory.poses
        known = [
            (pose, (true.x_m, true.y_m))
            for pose, stamp_ns in zip(
                path, result.estimate.trajectory.stamps_ns.tolist(), strict=True
            )
            if result.reference is not None and (true := result.reference.at(stamp_ns)) is not None
        ]
        if len(known) > 1 and result.reference is not None:
            motion = align(
                np.array([true for _, true in known]), np.array([pose[:2] for pose, _ in known])
            )
            inside = (result.reference.stamps_ns >= result.estimate.trajectory.stamps_ns[0]) & (
                result.reference.stamps_ns <= result.estimate.trajectory.stamps_ns[-1]
            )
            track = result.reference.poses[inside, :2]
            axes.plot(
                *moved(motion, track).T,
                color="tab:green",
                linewidth=2.5,
                label="reference, aligned",
            )
            if result.true_landmarks:
                places = moved(motion, np.array([*result.true_landmarks.values()]))
                axes.plot(*places.T, "^", color="tab:green", markersize=7, label="their truth")
        if result.online is not None:
            poses = result.online.trajectory.poses
            axes.plot(
                poses[:, 0],
                poses[:, 1],
                color="tab:orange",
                linewidth=0.6,
                alpha=0.7,
                label="online",
            )
        axes.plot(path[:, 0], path[:, 1], color="tab:red", linewidth=1.2, label="trajectory")
        marks = result.landmarks
        axes.plot(*marks.positions.T, "k+", markersize=7, label="landmarks")
        circle = np.linspace(0.0, 2.0 * np.pi, 40)
        for place, P in zip(marks.positions, marks.covariances, strict=True):
            root = np.linalg.cholesky(P + 1e-12 * np.eye(2))
            ring = place + 2.448 * np.stack([np.cos(circle), np.sin(circle)], axis=1) @ root.T
            axes.plot(*ring.T, color="black", linewidth=0.5)
        see_from_above(axes, "datalim")
        axes.legend(loc="best")
        axes.grid(visible=True, alpha=0.3)
        figure.suptitle(result.name)
