"""A plan as a picture; needs the extra `plot`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from robotctl.cli.picture import draw_costs, draw_map, drawing, see_from_above
from robotctl.planning.map.costs import costs_of
from robotctl.planning.path.global_planning.plan import PlanFailure
from robotctl.workbench.planning.plan import PlanResult

_OUTLINES = 40
"""Drawn along a path at most."""


def save_plot(result: PlanResult, file: Path) -> None:
    """Draw the map with what nearness to walls costs, doors, and the path with the robot's outline.

    Without a path, the place that fails. Where the robot's middle cannot be the costs are darkest.
    """
    with drawing(file, 9.0, 9.0) as figure:
        axes = figure.subplots()
        draw_map(axes, result.space.grid)
        if len(result.space.footprint.corners) and result.config.comfort_m > 0.0:
            comfort_m = result.config.margin_m + result.config.comfort_m
            draw_costs(axes, costs_of(result.space, comfort_m))
        if len(doors := result.space.closed.doors.places):
            axes.plot(*doors.T, "D", color="tab:purple", label="door")
        answer = result.answer
        if isinstance(answer, PlanFailure):
            if answer.place is not None:
                axes.plot(*answer.place, "rx", markersize=14, markeredgewidth=3)
            figure.suptitle(answer.text, wrap=True, fontsize="medium")
        else:
            poses = answer.poses
            shown = poses[:: max(1, math.ceil(len(poses) / _OUTLINES))]
            for corners in map(np.array, result.space.footprint.outlines):
                for x, y, theta in (*shown, poses[-1]):
                    turn = np.array(
                        [[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]]
                    )
                    axes.fill(*(corners @ turn + (x, y)).T, color="tab:blue", alpha=0.25)
            axes.plot(poses[:, 0], poses[:, 1], color="tab:red", linewidth=1.5)
            axes.plot(*poses[0, :2], "o", color="tab:green", label="start")
            axes.plot(*poses[-1, :2], "*", color="tab:orange", markersize=12, label="goal")
            axes.legend(loc="upper right")
            figure.suptitle(f"{result.planner}: {answer.length_m:.2f} m")
        see_from_above(axes)
