"""Information matrices as files have them: rounded, singular, empty, or not positive at all."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.factor import (
    FactorBlock,
    clipped,
    is_definite,
    is_semidefinite,
)
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import LARGEST
from robotctl.logs.graphs.graph_format import GraphFile, GraphFormatError

_CLIP = "robotctl optimise --clip-indefinite puts 0 in their place"


def judged(path: Path, file: GraphFile, *, clip: bool) -> GraphFile:
    """Return a graph whose information is positive semidefinite, with notes on what is odd.

    Parameters
    ----------
    path
        Path of the file, for messages.
    file
        What was read from it.
    clip
        Whether negative eigenvalues become 0; else they are refused.

    Raises
    ------
    GraphFormatError
        If an information matrix has a negative eigenvalue; it names the line.
    """
    blocks = [_without_specks(block) for block in file.graph.blocks]
    empty, singular, indefinite = _Found(path, file), _Found(path, file), _Found(path, file)
    for index, block in enumerate(blocks):
        good = is_definite(block.information)
        if np.all(good):
            continue
        bad = ~is_semidefinite(block.information)
        if np.any(bad):
            least = float(np.linalg.eigvalsh(block.information[bad])[0, 0])
            indefinite.add(index, bad, least)
            information = block.information.copy()
            information[bad] = clipped(information[bad])
            if np.abs(information).max() > LARGEST:
                raise GraphFormatError(
                    f"{indefinite.first}: the information matrix with 0 in place of its negative "
                    f"eigenvalues has a number above {LARGEST:g}"
                )
            blocks[index] = replace(block, information=information)
        nothing = ~np.any(block.information, axis=(1, 2))
        empty.add(index, nothing)
        singular.add(index, ~good & ~bad & ~nothing)
    if indefinite.count and not clip:
        more = f" (as in {indefinite.count} factors)" if indefinite.count > 1 else ""
        raise GraphFormatError(
            f"{indefinite.first}: the information matrix is not positive semidefinite{more}: it "
            f"has the eigenvalue {indefinite.least:.3g}, 0 and more are allowed; {_CLIP}"
        )
    notes = [
        text.format(found)
        for found, text in (
            (indefinite, "{}: information with negative eigenvalues, taken with 0 in their place"),
            (singular, "{}: information that is singular, which says nothing of some direction"),
            (empty, "{}: no information, so they count for nothing"),
        )
        if found.count
    ]
    if any(block is not given for block, given in zip(blocks, file.graph.blocks, strict=True)):
        file = replace(file, graph=FactorGraph(file.graph.ids, tuple(blocks)))
    return replace(file, notes=(*file.notes, *notes))


def _without_specks(block: FactorBlock) -> FactorBlock:
    """Return a block with 0 for information whose inverse would be beyond all bounds."""
    specks = (block.information != 0.0) & (np.abs(block.information) < 1.0 / LARGEST)
    if not np.any(specks):
        return block
    return replace(block, information=np.where(specks, 0.0, block.information))


class _Found:
    """Factors with the same oddity."""

    def __init__(self, path: Path, file: GraphFile) -> None:
        self._path, self._file = path, file
        self.count, self.least, self.first = 0, 0.0, ""

    def add(self, index: int, mask: NDArray[np.bool_], least: float = 0.0) -> None:
        """Add factors of a block; `least` is the smallest eigenvalue of the first of them."""
        if not self.count and np.any(mask):
            self.first, self.least = self._where(index, int(np.argmax(mask))), least
        self.count += int(mask.sum())

    def _where(self, index: int, row: int) -> str:
        """Return where a factor is: its line, else its variables."""
        if self._file.lines:
            return f"{self._path}:{self._file.lines[index][row]}"
        graph = self._file.graph
        ends = [int(numbers[row]) for numbers in graph.numbers(graph.blocks[index])]
        return f"{self._path}: {graph.names(ends)}"

    def __str__(self) -> str:
        factors = "1 factor" if self.count == 1 else f"{self.count} factors"
        return f"{factors} ({'in' if self.count == 1 else 'first'} {self.first})"
