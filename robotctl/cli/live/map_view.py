"""The map of a run on the terminal: walls, robot, plan, what the sensors see, and the truth."""

from __future__ import annotations

import itertools
import math
from collections import deque
from typing import Final

import numpy as np
from rich.text import Text

from robotctl.app.simulation.run_status import RunStatus
from robotctl.cli.live.canvas import Canvas
from robotctl.messages.estimation import PlanView
from robotctl.messages.map_message import grid_of
from robotctl.model.wall_map import WallMap
from robotctl.words import counted

_ARROWS: Final = "→↗↑↖←↙↓↘"
_PATH, _ARC, _SEEN, _PERSON = "green", "bold yellow", "red", "bold magenta"
_BLOCKED, _DEAR = "on grey30", "on grey15"
"""Grounds of places that the middle of the robot cannot take, and of those that it avoids."""
_OLD: Final = "dim"
"""Style for what a silent process said last."""
_TOUCHES: Final = 100
"""Cost of the first [%]."""


class RunMap:
    """Draws one run.

    Parameters
    ----------
    walls
        Of the world.
    """

    def __init__(self, walls: WallMap) -> None:
        self._walls = walls
        self._trail: deque[tuple[float, float]] = deque(maxlen=2000)
        self._drawn_walls = Canvas(0, 0, walls.bounds)

    def draw(self, progress: RunStatus, columns: int, rows: int) -> Canvas:
        """Return the drawing in so many characters."""
        here = progress.pose
        if here is not None:
            self._trail.append((here.x_m, here.y_m))
        canvas = self._ground(progress, Canvas.fitting(columns, rows, self._walls.bounds))
        for x_m, y_m in self._trail:
            canvas.point(x_m, y_m)
        if progress.cloud is not None:
            for x_m, y_m, _ in np.frombuffer(progress.cloud.poses, "<f4").reshape(-1, 3):
                canvas.point(x_m, y_m)
        if progress.plan is not None:
            _draw_plan(canvas, progress.plan, _OLD if progress.navigation_silence else "")
        _mark_moving(canvas, progress)
        if here is not None:
            for thing in progress.view.obstacles if progress.view is not None else ():
                seen = _OLD if progress.camera_silence else _SEEN
                canvas.mark(*here.apply(thing.x_m, thing.y_m), "x", seen)
            arrow = _ARROWS[round(here.theta_rad / (math.pi / 4)) % 8]
            canvas.mark(here.x_m, here.y_m, arrow, _OLD if progress.control_silence else "bold")
        return canvas

    def _ground(self, progress: RunStatus, empty: Canvas) -> Canvas:
        """Return the walls, or the map as it grows, on a canvas."""
        if progress.map is None:
            return self._walls_on(empty)
        grid = grid_of(progress.map)
        for x_m, y_m in grid.centre_of(np.argwhere(grid.occupied())):
            empty.point(x_m, y_m)
        return empty

    def _walls_on(self, empty: Canvas) -> Canvas:
        """Return the walls on a canvas, drawn once for each size: a map has thousands."""
        drawn = self._drawn_walls
        if (drawn.columns, drawn.rows) != (empty.columns, empty.rows):
            drawn = self._drawn_walls = empty
            for x1_m, y1_m, x2_m, y2_m in self._walls.segments:
                drawn.line(x1_m, y1_m, x2_m, y2_m)
        return drawn.copy()


def title(progress: RunStatus) -> str:
    """Say what the map shows, and how well the robot knows its place."""
    state = progress.localisation
    if state is None:
        return "map" if progress.map is None else "map as it grows"
    sigma_m = math.sqrt(max(0.0, state.covariance[0] + state.covariance[3]))
    particles = f", {counted(state.particles, 'particle')}" if state.particles else ""
    silent = f" ({progress.navigation_silence})" if progress.navigation_silence else ""
    return f"{state.method}: {state.status.name.lower()}, ±{sigma_m:.2f} m{particles}{silent}"


def legend(progress: RunStatus) -> Text:
    """Explain what is drawn of the plan and of what moves, if there is any of it."""
    plan = progress.plan
    if plan is None:
        return Text()
    named = [("path", _PATH), ("arc", _ARC)] if plan.path else []
    named += [("seen", _SEEN)] if plan.obstacles else []
    named += [("P moves", _PERSON)] if plan.moving else []
    return Text(" ").join(Text(word, style) for word, style in named)


def _mark_moving(canvas: Canvas, progress: RunStatus) -> None:
    """Mark people and the robot where they truly are, and what the robot sees move."""
    if progress.truth is not None:
        for x_m, y_m in progress.truth.people:
            canvas.mark(x_m, y_m, "p", "dim")
        old = _OLD if progress.truth_silence else ""
        canvas.mark(progress.truth.x_m, progress.truth.y_m, "o", old)
    if progress.plan is not None:
        for x_m, y_m, *_ in progress.plan.moving:
            canvas.mark(x_m, y_m, "P", _OLD if progress.navigation_silence else _PERSON)


def _draw_plan(canvas: Canvas, plan: PlanView, old: str) -> None:
    """Draw costs, obstacles that are on no map, path and arc; `old`: how one of before looks."""
    costs = grid_of(plan.costs)
    for style, wanted in ((_DEAR, costs.cells > 0), (_BLOCKED, costs.cells == _TOUCHES)):
        for x_m, y_m in costs.centre_of(np.argwhere(wanted)).tolist():
            canvas.shade(x_m, y_m, style)
    for x_m, y_m in np.frombuffer(plan.obstacles, "<f4").reshape(-1, 2).tolist():
        canvas.point(x_m, y_m, old or _SEEN)
    for packed, style in ((plan.path, _PATH), (plan.arc, _ARC)):
        poses = np.frombuffer(packed, "<f4").reshape(-1, 3).tolist()
        for (x1_m, y1_m, _), (x2_m, y2_m, _) in itertools.pairwise(poses):
            canvas.line(x1_m, y1_m, x2_m, y2_m, old or style)
