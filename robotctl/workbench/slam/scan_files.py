"""Files of `robotctl slam --sensor NAME`."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from robotctl.estimation.slam.factors.between import BETWEEN_2D
from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.variables import SE2 as POSES
from robotctl.estimation.slam.keyframes.back_end import as_row
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.saved_map import HEADING, whole_map
from robotctl.estimation.slam.keyframes.verification import Closure
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.logs.formats.tum import write_tum
from robotctl.logs.graphs.g2o import G2O
from robotctl.logs.graphs.graph_format import GraphFile
from robotctl.maps.map_file import save_map
from robotctl.runtime.storage.record_log import packed
from robotctl.workbench.places.images import write_pairs
from robotctl.workbench.slam.scans import ScanResult

_STRAYS: Final = 0.0002
"""As in `robotctl map`: a map is cropped where that cuts off no more of the known cells."""


def graph_of(mapper: SlamMapper) -> GraphFile:
    """Return the graph of the keyframes at the estimate, without links that are switched off."""
    back_end, build = mapper.back_end, GraphBuilder()
    build.variables(POSES, np.arange(len(back_end.poses)), back_end.poses)
    kept = [
        (link, weight)
        for link, weight in zip(back_end.links, back_end.weights, strict=True)
        if weight >= OFF
    ]
    if kept:
        build.factors(
            BETWEEN_2D,
            np.array([(link.first, link.second) for link, _ in kept]),
            np.array([as_row(link.pose) for link, _ in kept]),
            np.array([weight * back_end.counted(link) for link, weight in kept]),
        )
    return GraphFile(*build.build(), np.empty(0, np.int64))


def write_scan_results(result: ScanResult, folder: Path) -> None:
    """Write the files of a result into a folder.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    write_tum(folder / "trajectory.tum", result.estimate)
    write_tum(folder / "online.tum", result.online)
    save_map(folder / "map", result.grid.map_rows(strays=_STRAYS))
    G2O.write(folder / "graph.g2o", graph_of(result.mapper))
    place = result.place.keyframe, result.place.pose
    record = whole_map(result.mapper, result.sensor, result.frame, place)
    (folder / "map.keyframes").write_bytes(HEADING + packed([record]))
    _write_closures(folder / "closures.csv", result.mapper)
    if result.images is not None:
        write_pairs(result.images, folder / "images.csv")
    text = json.dumps(result.report(), indent=2) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")


def _write_closures(path: Path, mapper: SlamMapper) -> None:
    """Write what became of each loop that was looked at."""
    stamps = [each.stamp_ns for each in mapper.keyframes]

    def row(each: Closure) -> list[Any]:
        x, y, theta = as_row(each.pose).round(6).tolist()
        return [
            each.keyframe, each.other, stamps[each.keyframe], stamps[each.other], each.found_by,
            x, y, theta, round(each.score, 4), each.reason or "closed",
        ]  # fmt: skip

    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["keyframe", "other", "stamp_ns", "other_stamp_ns", "found_by", "x_m", "y_m",
             "theta_rad", "score", "outcome"]
        )  # fmt: skip
        writer.writerows(map(row, mapper.loops.log))
