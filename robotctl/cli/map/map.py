"""`robotctl map`: an occupancy grid from a recorded log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotctl.cli.console import plain_console, say_compiling
from robotctl.cli.options import takes_options
from robotctl.cli.progress import progress_bar
from robotctl.model.grid_map import count_values
from robotctl.workbench.localise.map_options import MapOptions

if TYPE_CHECKING:
    from robotctl.workbench.localise.mapping import MapResult


@takes_options
def map_log(options: MapOptions) -> None:
    """Map the lidar scans of a recorded log, at its reference poses or its odometry."""
    # It loads numba and OpenCV, which other subcommands can do without.
    from robotctl.workbench.localise.mapping import make_map  # noqa: PLC0415

    console = plain_console(stderr=True)
    say_compiling(console)
    with progress_bar(console, options.log.name, "mapping") as tell:
        result = make_map(options, tell)
    for note in result.notes:
        console.print(f"{options.log.name}: {note}", soft_wrap=True)
    print("\n".join(_lines(result)))


def _lines(result: MapResult) -> list[str]:
    """Return what to say of a map."""
    options, grid, figures = result.options, result.rows, result.figures
    rows, columns = grid.shape
    side_m = grid.resolution_m
    poses = "reference poses" if result.from_reference else "odometry: the log has no reference"
    values = count_values(grid)
    free, occupied = int(values[:50].sum()), int(values[50:101].sum())
    unknown = rows * columns - free - occupied
    size = f"{columns * side_m:.2f} m x {rows * side_m:.2f} m"
    corner = f"({grid.origin.x_m:.3f}, {grid.origin.y_m:.3f}) m"
    mean = f"{figures.mean_entropy_bits:.3f} bit per observed cell"
    return [
        f"{options.log}: {result.used} of {result.of} scans ({options.scans}), at {poses}",
        f"size: {size}, {columns} x {rows} cells of {side_m:g} m, from {corner}",
        f"cells: {free} free, {occupied} occupied, {unknown} unknown",
        f"coverage: {figures.seen_m2:.1f} m2 seen, {figures.coverage:.1%} of the rectangle",
        f"entropy: {figures.entropy_bits:.0f} bit, {mean}",
        f"written: {result.files[0]}, {result.files[1]}",
    ]
