"""Poses that a file says are one and the same, as TORO's EQUIV does."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robotctl.estimation.slam.graph.factor import Ints
from robotctl.logs.graphs.graph_format import GraphFormatError


class Merging:
    """Which pose stands for which: of all that are one, the smallest id."""

    def __init__(self) -> None:
        self._parents: dict[int, int] = {}
        self._lines: list[tuple[int, int, int]] = []
        self.left_out = 0
        """Factors between poses that are one."""

    def __bool__(self) -> bool:
        return bool(self._lines)

    def add(self, line: int, a: int, b: int) -> None:
        """Make two ids one, as a line says."""
        self._lines.append((line, a, b))
        first, second = sorted((self._root(a), self._root(b)))
        if first != second:
            self._parents[second] = first

    def _root(self, each: int) -> int:
        while (above := self._parents.get(each)) is not None:
            self._parents[each] = self._parents.get(above, above)  # the way is short next time
            each = above
        return each

    def renamed(self, ids: Ints) -> Ints:
        """Return ids with those in the place of others that stand for them."""
        unique, places = np.unique(ids, return_inverse=True)
        renamed = np.array([self._root(each) for each in unique.tolist()], np.int64)
        return renamed[places].reshape(ids.shape)

    def pairs(self) -> Ints:
        """Return the ids that are gone, and those that stand for them, (m, 2)."""
        gone = sorted(self._parents)
        return np.array([(each, self._root(each)) for each in gone], np.int64).reshape(-1, 2)

    def check(self, path: Path, ids: Ints) -> None:
        """Refuse to merge what is not among the ids of a file, ascending.

        Raises
        ------
        GraphFormatError
            With file and line.
        """
        for line, a, b in self._lines:
            for each in (a, b):
                at = int(np.searchsorted(ids, each))
                if at == len(ids) or ids[at] != each:
                    raise GraphFormatError(
                        f"{path}:{line}: {each} is to be merged: there is no such pose"
                    )

    def notes(self) -> list[str]:
        """Return what the user should know."""
        if not self._parents:
            return []
        count = len(self._parents)
        merged = "1 pose is" if count == 1 else f"{count} poses are"
        dropped = f"; {self.left_out} edges between them count for nothing" if self.left_out else ""
        return [f"{merged} merged with another{dropped}"]
