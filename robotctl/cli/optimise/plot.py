"""A graph before and after its optimisation; needs the extra `plot`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from robotctl.estimation.slam.graph.factor_graph import Values
from robotctl.workbench.graphs.optimise import OptimiseResult

_FRAMES_PER_S: Final = 2


def save_plot(result: OptimiseResult, file: Path) -> None:
    """Draw the start, the optimum, and chi2 by iteration."""
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    figure = Figure(figsize=(13.0, 5.0), dpi=120, layout="constrained")
    before, after, course = figure.subplots(1, 3)
    draw_graph(before, result, result.start)
    before.set_title(f"start: {result.options.init}")
    draw_graph(after, result, result.solution.values)
    after.set_title(f"optimum: {result.options.solver}")
    course.semilogy(result.solution.chi2, "o-", markersize=3)
    course.set_xlabel("iteration")
    course.set_title(f"chi2: {result.solution.chi2[-1]:.6g}")
    figure.savefig(file)


def save_animation(
    result: OptimiseResult, file: Path, tell: Callable[[int, int], None] = lambda *_: None
) -> None:
    """Draw the start and the graph after each iteration, one after the other."""
    from matplotlib.animation import FuncAnimation, PillowWriter  # noqa: PLC0415 - an extra
    from matplotlib.figure import Figure  # noqa: PLC0415 - an extra

    figure = Figure(figsize=(6.0, 6.0), dpi=90, layout="constrained")
    axes = figure.subplots()
    frames = len(result.course)

    def draw(frame: int) -> tuple[()]:
        axes.clear()
        draw_graph(axes, result, result.course[frame])
        axes.set_title(f"iteration {frame}: chi2 {result.solution.chi2[frame]:.6g}")
        tell(frame + 1, frames)
        return ()

    film = FuncAnimation(figure, draw, frames)
    film.save(file, PillowWriter(fps=_FRAMES_PER_S))


def draw_graph(axes: Any, result: OptimiseResult, values: Values) -> None:
    """Draw poses, points and the factors between poses, from above; those switched off in red."""
    poses = result.graph.poses
    for block, off in zip(result.graph.blocks, result.switched_off(), strict=True):
        kinds = block.kind.variables
        if len(kinds) != 2 or not all(kind.is_pose for kind in kinds):
            continue
        ends = np.stack(
            [values[k][r, :2] for k, r in zip(kinds, block.variables, strict=True)], axis=1
        )
        for mask, colour in ((~off, "0.75"), (off, "tab:red")):
            # One line with gaps is drawn faster than many.
            gaps = np.full((int(mask.sum()), 1, 2), np.nan)
            line = np.concatenate([ends[mask], gaps], axis=1).reshape(-1, 2)
            axes.plot(line[:, 0], line[:, 1], color=colour, linewidth=0.5)
    for kind in result.graph.ids:
        if kind is poses:
            axes.plot(*values[kind][:, :2].T, ".", color="tab:blue", markersize=1.5)
        else:
            axes.plot(*values[kind][:, :2].T, "+", color="tab:orange", markersize=5)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
