"""Graphs as lines of a tag, numbers of variables, and further numbers: read and written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.factor import FactorKind, Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import Floats, VariableKind
from robotctl.logs.formats.log_text import first_words, is_number, read_text
from robotctl.logs.graphs.graph_format import GraphFile, GraphFormatError
from robotctl.toml_source import nearest

LineError: TypeAlias = Callable[[int, str], GraphFormatError]
"""Makes the error of the line with an index, from what is wrong."""


@dataclass(frozen=True, slots=True)
class Rows:
    """The lines of one tag.

    Parameters
    ----------
    ids
        (n, ids).
    numbers
        (n, columns).
    lines
        Number of each line in the file, from 1, (n,).
    path
        Of the file.
    """

    ids: Ints
    numbers: Floats
    lines: Ints
    path: Path

    def check(self, is_good: NDArray[np.bool_], problem: str) -> None:
        """Refuse the first line that is not good, (n,).

        Raises
        ------
        GraphFormatError
            With file and line.
        """
        if not np.all(is_good):
            line = self.lines[int(np.argmin(is_good))]
            raise GraphFormatError(f"{self.path}:{line}: {problem}")


@dataclass(frozen=True, slots=True)
class Tag:
    """What lines of one tag mean.

    Parameters
    ----------
    ids
        How many variables a line names.
    columns
        Names of its numbers.
    add
        Puts rows into a graph; None: they are passed over.
    optional
        How many of the last columns may be missing; they are 0 then.
    """

    ids: int
    columns: tuple[str, ...]
    add: Callable[[GraphBuilder, Rows], None] | None
    optional: int = 0


def tags_of(path: Path) -> set[str]:
    """Return the tags at the beginning of a text file."""
    lines = first_words(path).splitlines()
    return {words[0] for line in lines[:-1] or lines if (words := line.split())}


def read_tagged(path: Path, tags: Mapping[str, Tag], fix: str = "") -> GraphFile:
    """Read a graph.

    Parameters
    ----------
    path
        The file, plain or gzip.
    tags
        What may stand in it.
    fix
        The tag of lines that name fixed variables; "" if there is none.

    Raises
    ------
    GraphFormatError
        If a line is wrong.
    OSError
        If the file cannot be read.
    """
    lines: dict[str, list[tuple[int, list[str]]]] = {}
    fixed: list[tuple[int, str]] = []
    for number, line in enumerate(read_text(path).lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0] == fix:
            fixed += [(number, word) for word in words[1:]]
        elif words[0] in tags:
            lines.setdefault(words[0], []).append((number, words))
        else:
            hint = nearest(words[0], list(tags))
            raise GraphFormatError(f"{path}:{number}: {words[0]!r}: unknown{hint}")
    builder = GraphBuilder()
    for name, own in lines.items():
        tag = tags[name]
        if tag.add is not None:
            tag.add(builder, _rows(path, tag, own))
    graph, values, known = builder.build()
    held = [_number(path, graph, each) for each in fixed]
    if graph.size == 0:
        raise GraphFormatError(f"{path}: no variables and no factors in it")
    return GraphFile(graph, values, known, np.array(sorted(held), np.int64))


def _number(path: Path, graph: FactorGraph, fixed: tuple[int, str]) -> int:
    """Return the number of a variable that a line says is fixed."""
    line, word = fixed
    for kind, ids in graph.ids.items():
        if word.isdigit() and int(word) in ids:
            return graph.first(kind) + int(np.searchsorted(ids, int(word)))
    raise GraphFormatError(f"{path}:{line}: {word} is to be fixed: there is no such variable")


def _rows(path: Path, tag: Tag, lines: Sequence[tuple[int, list[str]]]) -> Rows:
    """Return the lines of a tag as numbers."""
    begin, width = 1 + tag.ids, len(tag.columns)
    try:
        if any(len(words) != begin + width for _, words in lines):
            if not tag.optional:
                raise ValueError
            lines = [(n, _padded(words, begin + width, tag.optional)) for n, words in lines]
        ids = np.array(
            list(map(int, chain.from_iterable(words[1:begin] for _, words in lines))), np.int64
        )
        numbers = np.array(
            list(map(float, chain.from_iterable(words[begin:] for _, words in lines)))
        )
        if not np.all(np.isfinite(numbers)):
            raise ValueError
    except ValueError:
        raise _first_error(path, tag, lines) from None
    return Rows(
        ids.reshape(len(lines), tag.ids),
        numbers.reshape(len(lines), width),
        np.array([number for number, _ in lines], np.int64),
        path,
    )


def _padded(words: list[str], length: int, optional: int) -> list[str]:
    if len(words) == length - optional:
        return [*words, *["0"] * optional]
    if len(words) != length:
        raise ValueError
    return words


def _first_error(path: Path, tag: Tag, lines: Iterable[tuple[int, list[str]]]) -> GraphFormatError:
    """Return what is wrong with the first wrong line."""
    begin = 1 + tag.ids
    for number, words in lines:
        wanted = begin + len(tag.columns)
        if len(words) not in (wanted, wanted - tag.optional):
            names = [f"id {i + 1}" for i in range(tag.ids)] if tag.ids > 1 else ["id"]
            return GraphFormatError(
                f"{path}:{number}: {words[0]}: found {len(words) - 1} words, needed are "
                f"{wanted - 1}: {', '.join([*names, *tag.columns])}"
            )
        for word in words[1:begin]:
            if not word.removeprefix("-").isdigit():
                return GraphFormatError(
                    f"{path}:{number}: {words[0]}: id {word!r}: a whole number is needed"
                )
        for name, word in zip(tag.columns, words[begin:], strict=False):
            if not is_number(word) or not np.isfinite(float(word)):
                return GraphFormatError(
                    f"{path}:{number}: {words[0]}: {name} {word!r}: a finite number is needed"
                )
    raise AssertionError("no line is wrong")


def symmetric(upper: Floats, size: int) -> Floats:
    """Return symmetric matrices (n, size, size) of their upper triangles by rows, (n, ...)."""
    matrices = np.empty((len(upper), size, size))
    rows, columns = np.triu_indices(size)
    matrices[:, rows, columns] = upper
    matrices[:, columns, rows] = upper
    return matrices


def upper(matrices: Floats) -> Floats:
    """Return the upper triangles by rows, (n, ...), of matrices (n, size, size)."""
    rows, columns = np.triu_indices(matrices.shape[1])
    result: Floats = matrices[:, rows, columns]
    return result


def triangle(size: int, letter: str = "I") -> tuple[str, ...]:
    """Return names of the entries of an upper triangle."""
    return tuple(f"{letter}{i + 1}{j + 1}" for i in range(size) for j in range(i, size))


def checked(rows: Rows, matrices: Floats, what: str = "information") -> Floats:
    """Return matrices (n, size, size) that are positive definite.

    Raises
    ------
    GraphFormatError
        If one is not.
    """
    rows.check(
        np.linalg.eigvalsh(matrices)[:, 0] > 0.0, f"the {what} matrix is not positive definite"
    )
    return matrices


def variables(kind: VariableKind, convert: Callable[[Floats], Floats]) -> Callable[..., None]:
    """Return what adds variables, of which `convert` makes values of numbers."""

    def add(builder: GraphBuilder, rows: Rows) -> None:
        ids, counts = np.unique(rows.ids[:, 0], return_counts=True)
        for twice in ids[counts > 1][:1]:
            last = np.flatnonzero(rows.ids[:, 0] == twice)[1]
            rows.check(np.arange(len(rows.ids)) != last, f"{kind.name} {twice} is there already")
        builder.variables(kind, rows.ids[:, 0], convert(rows.numbers))

    return add


def factors(
    kind: FactorKind, split: Callable[[Rows], tuple[Floats, Floats]]
) -> Callable[[GraphBuilder, Rows], None]:
    """Return what adds factors, of which `split` makes measurements and information."""

    def add(builder: GraphBuilder, rows: Rows) -> None:
        if len(kind.variables) == 2 and kind.variables[0] is kind.variables[1]:
            rows.check(rows.ids[:, 0] != rows.ids[:, 1], "links a variable with itself")
        measurements, information = split(rows)
        builder.factors(kind, rows.ids, measurements, information)

    return add


def lines_of(tag: str, ids: NDArray[np.int64], numbers: Floats) -> list[str]:
    """Return lines of a tag, with all digits that the numbers have."""
    return [
        " ".join([tag, *map(str, own), *map(repr, row)])
        for own, row in zip(ids.tolist(), numbers.tolist(), strict=True)
    ]
