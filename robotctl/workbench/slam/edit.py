"""`robotctl slam edit`: a map of keyframes, changed as a person says, and what that made of it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from robotctl.estimation.grid.occupancy_grid import OccupancyGrid
from robotctl.estimation.slam.front_end.surface import Floats
from robotctl.estimation.slam.keyframes.growing_map import GrowingMap
from robotctl.estimation.slam.keyframes.saved_map import KeyframeMap, SavedOdometry
from robotctl.estimation.slam.local_scans.registry import load_source
from robotctl.estimation.slam.robust.robust_cost import OFF
from robotctl.estimation.slam.verdict.map_check import breaks, contradicted_places, shifts_of
from robotctl.estimation.slam.verdict.verdict import Quality, RunFigures, Verdict, verdict_of
from robotctl.logs.formats.keyframes_log import load_keyframes
from robotctl.workbench.slam.applied_edits import REACH, AppliedEdits, EditError
from robotctl.workbench.slam.edited_map import EditedMap, Progress
from robotctl.workbench.slam.edits import NO_MAP, MapEdits, load_edits, offsets


@dataclass(slots=True, eq=False)
class EditedResult:
    """A map after its edits.

    Parameters
    ----------
    sources
        Files of the map and of those joined to it.
    sensor
        Of the scans.
    odometry
        The robot's odometry at its last place.
    edited
        Keyframes and graph, in `world`.
    grid
        The map, of the scans of all keyframes.
    verdict
        How good it is by its scans; None where scans are gathered along stretches.
    breaks
        Keyframes before which nothing joins the map.
    outcomes
        What became of each edit.
    linked_again
        Number of links that were found afterwards.
    moved_m
        Distances by which the keyframes of the first map moved, (n,) [m].
    times_ms
        CPU time of edits and map [ms].
    """

    sources: list[Path]
    sensor: str
    odometry: SavedOdometry | None
    edited: EditedMap
    grid: OccupancyGrid
    verdict: Verdict | None
    breaks: list[int]
    outcomes: list[dict[str, Any]]
    linked_again: int
    moved_m: Floats
    times_ms: dict[str, float] = field(default_factory=dict)

    def report(self) -> dict[str, Any]:
        """Return the figures; the keys stand in docs/slam.md."""
        back_end, verdict, figures = self.edited.back_end, self.verdict, self.grid.figures()
        return {
            "map": str(self.sources[0]),
            "joined": [str(each) for each in self.sources[1:]],
            "verdict": None if verdict is None else verdict.quality.value,
            "reasons": [] if verdict is None else list(verdict.reasons),
            "breaks": self.breaks,
            "edits": self.outcomes,
            "linked_again": self.linked_again,
            "keyframes": len(self.edited.keyframes),
            "links": len(back_end.links),
            "links_of_loops": int(np.count_nonzero(back_end.links.is_loop)),
            "given": int(np.count_nonzero(back_end.links.is_given)),
            "switched_off": sum(weight < OFF for weight in back_end.weights),
            "moved_m": {
                "rms": math.sqrt(float(np.mean(self.moved_m**2))),
                "max": float(self.moved_m.max()),
            },
            "grid": {
                "seen_m2": figures.seen_m2,
                "mean_entropy_bits": figures.mean_entropy_bits,
            },
            "time_ms": self.times_ms,
        }


def edit_map(file: Path, edits_file: Path | None, progress: Progress) -> EditedResult:
    """Apply a file of edits to a map of keyframes; without one, the map is only looked at.

    Raises
    ------
    RobotctlError
        If a file cannot be read or is wrong, or scans do not bear an edit out.
    """
    began_ns = time.process_time_ns()
    own = load_keyframes(file)
    if own is None:
        raise EditError(f"{file}: {NO_MAP if file.exists() else 'no such file'}")
    edits, maps = MapEdits(), dict[str, KeyframeMap]()
    if edits_file is not None:
        edits, maps = load_edits(edits_file, own)
    config = load_source(own.sensor).config
    edited = EditedMap([own, *maps.values()], config)
    linked_again, work = 0, AppliedEdits(edited, edits_file or file, offsets(own, maps))
    if edits_file is not None:
        work.apply(edits)
        edited.load()
        if edits.join or edits.move or edits.loop:
            linked_again = edited.link_again(work.refused, REACH, progress)
        edited.back_end.finish()
    edited_ns = time.process_time_ns()
    grid = OccupancyGrid()
    grid.update_scans(edited.back_end.poses, [each.scan for each in edited.keyframes])
    gaps, verdict = _checked(edited.growing, work.contradicted())
    is_first = edited.origins[:, 0] == 0
    off = (edited.back_end.poses - edited.before)[is_first]
    folder = Path() if edits_file is None else edits_file.parent
    times_ms = {
        "edits": 1e-6 * (edited_ns - began_ns),
        "map": 1e-6 * (time.process_time_ns() - edited_ns),
    }
    return EditedResult(
        [file, *(folder / each for each in maps)], own.sensor, own.odometry, edited, grid,
        verdict,
        [work.said(each) for each in gaps], work.outcomes, linked_again,
        np.hypot(off[:, 0], off[:, 1]), times_ms,
    )  # fmt: skip


def _checked(growing: GrowingMap, contradicted: list[str]) -> tuple[list[int], Verdict | None]:
    """Return where the way is broken, and the verdict on a map, with edits that scans contradict.

    Scans that are gathered along a stretch tell nothing of the way; only such edits count.
    """
    gaps, verdict = [], Verdict(Quality.GOOD)
    if not growing.config.stretch_m:
        gaps = breaks(growing)
        figures = RunFigures(
            len(growing.keyframes), 0, 0, shifts_of(growing), None, len(gaps),
            *contradicted_places(growing),
        )  # fmt: skip
        verdict = verdict_of(figures, growing.config.tuning.verdict)
    elif not contradicted:
        return [], None
    if not contradicted:
        return gaps, verdict
    quality = Quality.DOUBTFUL if verdict.quality is Quality.GOOD else verdict.quality
    return gaps, Verdict(quality, (*verdict.reasons, *contradicted))
