"""What each format of graph files declares, and what is read; `graph_files.GRAPH_FORMATS` lists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import RobotctlError
from robotctl.estimation.slam.graph.factor import Ints
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
    """

    graph: FactorGraph
    values: Values
    known: dict[VariableKind, NDArray[np.bool_]]
    fixed: Ints


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
    """

    name: str
    suffix: str
    matches: Callable[[Path], bool]
    read: Callable[[Path], GraphFile]
    write: Callable[[Path, GraphFile], None]
