"""Signatures of places, and recognised images, as pictures; needs the extra `plot`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from robotctl.estimation.places.database import PlaceBook
from robotctl.estimation.places.signatures import Signature
from robotctl.workbench.places.images import MatchedImages
from robotctl.workbench.places.places import Recognised

_IN_A_ROW: Final = 4


def save_places(book: PlaceBook, file: Path) -> None:
    """Draw each place's signatures around the robot as it stood at its first visit."""
    rows = max(1, math.ceil(len(book.places) / _IN_A_ROW))
    figure = Figure(figsize=(3.0 * _IN_A_ROW, 3.3 * rows), dpi=120, layout="constrained")
    for i, place in enumerate(book.places):
        panel = figure.add_subplot(rows, _IN_A_ROW, i + 1, projection="polar")
        for visit in place.visits:
            turned = visit.pose.theta_rad - place.visits[0].pose.theta_rad
            _draw(panel, visit.signature, turned, book, "tab:blue")
        panel.set_title(place.name)
    figure.savefig(file)


def save_recognition(book: PlaceBook, found: Sequence[Recognised], file: Path) -> None:
    """Draw each turn over the most like place, as it would be turned there."""
    figure = Figure(figsize=(4.5 * len(found), 5.0), dpi=120, layout="constrained")
    for i, each in enumerate(found):
        panel = figure.add_subplot(1, len(found), i + 1, projection="polar")
        recognition, signature = each.recognition, each.visited.turn.signature
        turned_rad, title = 0.0, f"refused: {recognition.refusal.partition(':')[0]}"
        best = recognition.found
        if best is not None:
            turned_rad = best.rotation_rad
            title = f"{best.place}, turned by {math.degrees(turned_rad):.0f}°"
            visit = next(each for each in book.places if each.name == best.place).visits[0]
            _draw(panel, visit.signature, 0.0, book, "tab:gray")
        _draw(panel, signature, turned_rad, book, "tab:red")
        panel.set_title(title)
    figure.savefig(file)


def save_matched(matched: MatchedImages, truth: NDArray[np.bool_] | None, file: Path) -> None:
    """Draw the scores of all candidates, what was recognised, and the truth if it is known."""
    figure = Figure(figsize=(7.0, 7.0), dpi=120, layout="constrained")
    axes = figure.subplots()
    if truth is not None:
        axes.plot(*np.argwhere(truth).T[::-1], "s", color="0.85", markersize=5, label="truth")
    looked_at = [
        (each.place, i, each.score)
        for i, recognition in enumerate(matched.recognitions)
        for each in recognition.candidates
    ]
    if looked_at:
        columns, rows, scores = zip(*looked_at, strict=True)
        shades = axes.scatter(columns, rows, 9, scores, cmap="viridis", label="candidates")
        figure.colorbar(shades, label="score", shrink=0.6)
    if matched.pairs:
        found = np.array(matched.pairs)
        axes.plot(found[:, 1], found[:, 0], "o", color="tab:red", mfc="none", label="recognised")
    axes.set_xlabel("known image")
    axes.set_ylabel("image")
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.legend(loc="upper right")
    figure.savefig(file)


def _draw(panel: Any, signature: Signature, turned: float, book: PlaceBook, colour: str) -> None:
    """Draw the echoes of a signature, forward up; silence as ticks at the rim."""
    n = len(signature.depth_m)
    bearings = (np.arange(n) + 0.5) * (math.tau / n) + turned
    panel.set_theta_zero_location("N")
    panel.set_rmax(book.signatures.max_range_m)
    panel.plot(bearings, signature.depth_m, ".", color=colour, markersize=3.0, alpha=0.7)
    silent = signature.silence > 0.5
    rim = np.full(np.count_nonzero(silent), book.signatures.max_range_m)
    panel.plot(bearings[silent], rim, "|", color=colour, markersize=4.0, alpha=0.5)
    panel.set_xticklabels([])
