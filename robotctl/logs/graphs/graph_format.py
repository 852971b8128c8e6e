"""Declaration of a format of graph files, and its content; `GRAPH_FORMATS` lists them all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.graph.factor import FactorBlock, Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph, Values
from robotctl.estimation.slam.graph.variables import VariableKind


class GraphFormatError(RobotctlError):
    """A file of a graph cannot be read or written; the message names file and line, or what."""


@dataclass(frozen=True, slots=True, eq=False)
class GraphFile:
    """A graph as a file has it.

    Parameters
    ----------
    graph, values
        Variables, factors, and values of the variables.
    known
        Of each kind, which values the file gives, (n,); others are placeholders.
    fixed
        Numbers of the variables that the file says are fixed.
    merged
        Ids of poses that the file says are another pose, and of that one, (m, 2); only the second
        is in the graph.
    lines
        Of each block, the line that each factor stands in, (n,); empty if the format has none.
    notes
        What its user should know of the file, sentences.
    """

    graph: FactorGraph
    values: Values
    known: dict[VariableKind, NDArray[np.bool_]]
    fixed: Ints
    merged: Ints = field(default_factory=lambda: np.empty((0, 2), np.int64))
    lines: tuple[Ints, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class GraphFormat:
    """One format of graph files.

    Parameters
    ----------
    name
        For messages.
    suffix
        Of its files; it says in which format a graph is to be written.
    matches
        Whether a file, which exists, has this format.
    read
        Reads what `matches`; raises `GraphFormatError` with file and line, or `OSError`.
    write
        Writes a graph; raises `GraphFormatError` if the format has no word for a factor, or
        `OSError`.
    has_fixed
        Whether it has a word for fixed variables.
    """

    name: str
    suffix: str
    matches: Callable[[Path], bool]
    read: Callable[[Path], GraphFile]
    write: Callable[[Path, GraphFile], None]
    has_fixed: bool = False


def ids_of(file: GraphFile, block: FactorBlock) -> np.ndarray:
    """Return the ids of the variables of each factor, (n, variables)."""
    return np.column_stack(
        [
            file.graph.ids[kind][rows]
            for kind, rows in zip(block.kind.variables, block.variables, strict=True)
        ]
    )


def factor_lines(
    path: Path, file: GraphFile, name: str, lines: Callable[[FactorBlock], Iterable[str] | None]
) -> Iterator[str]:
    """Return the lines of all factors.

    Raises
    ------
    GraphFormatError
        If the format `name` has none for a kind.
    """
    found = []
    for block in file.graph.blocks:
        own = lines(block)
        if own is None:
            raise GraphFormatError(f"{path}: {name} has no factors {block.kind.name!r}")
        found.append(own)
    return chain.from_iterable(found)
