"""Files of `robotctl slam --sensor NAME`."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

from robotctl.estimation.grid.occupancy_grid import STRAYS, OccupancyGrid
from robotctl.estimation.slam.keyframes.back_end import BackEnd, as_row
from robotctl.estimation.slam.keyframes.mapper import SlamMapper
from robotctl.estimation.slam.keyframes.saved_map import HEADING, whole_map
from robotctl.estimation.slam.keyframes.verification import Closure
from robotctl.logs.formats.tum import write_tum
from robotctl.logs.graphs.g2o import G2O
from robotctl.maps.map_file import save_map
from robotctl.model.geometry.se2 import SE2
from robotctl.runtime.storage.record_log import packed
from robotctl.workbench.slam.edit import EditedResult
from robotctl.workbench.slam.keyframe_graph import graph_of
from robotctl.workbench.slam.scans import ScanResult


def write_scan_results(result: ScanResult, folder: Path) -> None:
    """Write the files of a result into a folder.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    write_tum(folder / "trajectory.tum", result.estimate)
    write_tum(folder / "online.tum", result.online)
    place = result.place.keyframe, result.place.pose
    _write_keyframes(folder, whole_map(result.mapper, result.sensor, result.frame, place))
    _write_map(folder, result.grid, result.mapper.back_end)
    _write_closures(folder / "closures.csv", result.mapper)
    if result.images is not None:
        from robotctl.workbench.places.images import write_pairs  # noqa: PLC0415 - OpenCV

        write_pairs(result.images, folder / "images.csv")
    _write_report(folder, result.report())


def write_edited(result: EditedResult, folder: Path) -> None:
    """Write the files of a map after edits into a folder.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    edited = result.edited
    _write_keyframes(folder, whole_map(edited, result.sensor, SE2(), edited.place, result.odometry))
    _write_map(folder, result.grid, edited.back_end)
    _write_table(folder / "keyframes.csv", result)
    _write_report(folder, result.report())


def _write_map(folder: Path, grid: OccupancyGrid, back_end: BackEnd) -> None:
    """Write a map as an image and as a graph."""
    save_map(folder / "map", grid.map_rows(strays=STRAYS))
    G2O.write(folder / "graph.g2o", graph_of(back_end))


def _write_keyframes(folder: Path, record: bytes) -> None:
    """Write a map to go on with."""
    with (folder / "map.keyframes").open("wb") as file:
        file.write(HEADING)
        file.write(packed([record]))


def _write_report(folder: Path, report: dict[str, Any]) -> None:
    """Write the figures."""
    text = json.dumps(report, indent=2) + "\n"
    (folder / "report.json").write_text(text, encoding="utf-8")


def _write_table(path: Path, result: EditedResult) -> None:
    """Write where each keyframe is, and from which file and number."""
    edited = result.edited
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["keyframe", "map", "number", "stamp_ns", "x_m", "y_m", "heading_deg"])
        rows = zip(
            edited.keyframes, edited.origins.tolist(), edited.back_end.poses.tolist(), strict=True
        )
        for number, (each, (source, was), (x, y, theta)) in enumerate(rows):
            writer.writerow(
                [number, result.sources[source], was, each.stamp_ns,
                 round(x, 4), round(y, 4), round(math.degrees(theta), 3)]
            )  # fmt: skip


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
