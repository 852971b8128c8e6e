"""Places and passages over a map; needs the extra `plot`."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from robotctl.cli.picture import draw_map, drawing, see_from_above
from robotctl.workbench.topology.topology import BuiltTopology


def save_plot(built: BuiltTopology, file: Path) -> None:
    """Draw each place in a colour, its name at its widest spot, and lines through passages."""
    with drawing(file, 11.0, 7.0) as figure:
        axes = figure.subplots()
        draw_map(axes, built.grid)
        topology, labels = built.topology.map, built.topology.labels
        colours = mpl.colormaps["tab20"]
        by_name = {}
        for number, place in enumerate(topology.places):
            by_name[place.name] = place
            points = built.grid.centre_of(np.argwhere(labels == number))
            shade = colours(number % 20)
            axes.plot(points[:, 0], points[:, 1], ",", color=shade, alpha=0.5)
            axes.plot(place.x_m, place.y_m, "o", color=shade, markeredgecolor="black")
            axes.annotate(place.name, (place.x_m, place.y_m), (0, 6), textcoords="offset points",
                          ha="center", fontsize="small")  # fmt: skip
        for passage in topology.passages:
            for end in (by_name[name] for name in passage.between):
                x, y = (end.x_m, passage.x_m), (end.y_m, passage.y_m)
                axes.plot(x, y, color="0.3", linewidth=0.8)
            axes.plot(passage.x_m, passage.y_m, "s", color="tab:red", markersize=5)
        see_from_above(axes)
