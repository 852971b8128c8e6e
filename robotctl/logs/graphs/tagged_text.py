"""Graphs as lines of a tag, ids of variables, and further numbers: read and written."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.estimation.slam.graph.builder import GraphBuilder
from robotctl.estimation.slam.graph.checks import is_sound, sound_rows
from robotctl.estimation.slam.graph.factor import FactorKind, Ints
from robotctl.estimation.slam.graph.factor_graph import FactorGraph
from robotctl.estimation.slam.graph.variables import LARGEST, SE2, SE3, Floats, VariableKind
from robotctl.logs.formats.log_text import LogText, first_words, is_number, read_text
from robotctl.logs.graphs.graph_format import GraphFile, GraphFormat, GraphFormatError
from robotctl.logs.graphs.merging import Merging
from robotctl.toml_source import nearest

_WHOLE: Final = re.compile(r"[+-]?[0-9]{1,40}")
_LARGEST_ID: Final = 2**63 - 1


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
        Path of the file.
    notes
        What its user should know, to be added to.
    """

    ids: Ints
    numbers: Floats
    lines: Ints
    path: Path
    notes: list[str] = field(default_factory=list)

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
    """Meaning of the lines of one tag.

    Parameters
    ----------
    ids
        How many variables a line names.
    columns
        Names of its numbers.
    add
        Puts rows into a graph.
    kind
        Kind of the factors or variables that it adds; None: it adds none.
    defaults
        What the last columns are where they are missing.
    """

    ids: int
    columns: tuple[str, ...]
    add: Callable[[GraphBuilder, Rows], None]
    kind: FactorKind | VariableKind | None = None
    defaults: tuple[str, ...] = ()


def tags_of(path: Path) -> set[str]:
    """Return the tags at the beginning of a text file."""
    return {words[0] for line in first_words(path).splitlines() if (words := line.split())}


def tagged_format(
    name: str,
    suffix: str,
    tags: Mapping[str, Tag],
    lines: Callable[[Path, GraphFile], Iterable[str]],
    *,
    own: Iterable[str] | None = None,
    fix: str = "",
    merge: str = "",
) -> GraphFormat:
    """Return a format whose files are lines of a tag.

    Parameters
    ----------
    name, suffix
        See `GraphFormat`.
    tags, fix, merge
        See `read_tagged`.
    lines
        From path and graph to the lines of its file; raises `GraphFormatError`.
    own
        Tags that tell the format; default: all that are read.
    """
    telling = set(tags if own is None else own)

    def write(path: Path, file: GraphFile) -> None:
        whole = lines(path, file)
        with path.open("w", encoding="ascii") as text:
            text.writelines(f"{line}\n" for line in whole)

    return GraphFormat(
        name,
        suffix,
        lambda path: bool(tags_of(path) & telling),
        lambda path: read_tagged(path, tags, fix, merge),
        write,
        has_fixed=bool(fix),
    )


def read_tagged(path: Path, tags: Mapping[str, Tag], fix: str = "", merge: str = "") -> GraphFile:
    """Read a graph.

    Parameters
    ----------
    path
        The file, plain or gzip.
    tags
        What may stand in it.
    fix
        The tag of lines that name fixed variables; "" if there is none.
    merge
        The tag of lines that name two poses that are one; "" if there is none.

    Raises
    ------
    GraphFormatError
        If a line is wrong, or the file is cut.
    OSError
        If the file cannot be read.
    """
    text = read_text(path)
    if text.is_cut:
        raise GraphFormatError(
            f"{path}: the compressed file is cut short after line {len(text.lines)}; a part of a "
            "graph is another graph: copy the whole file again"
        )
    lines, fixed, merging = _sorted_lines(text, tags, fix, merge)
    builder, notes = GraphBuilder(), list[str]()
    lines_of_kind: dict[FactorKind, list[Ints]] = {}
    ids = [np.empty(0, np.int64)]
    for name, own in lines.items():
        tag = tags[name]
        rows = _rows(path, tag, own, notes)
        ids.append(rows.ids.ravel())
        rows = _merged(rows, tag, merging)
        if not len(rows.lines):
            continue
        tag.add(builder, rows)
        if isinstance(tag.kind, FactorKind):
            lines_of_kind.setdefault(tag.kind, []).append(rows.lines)
    graph, values, known = builder.build()
    if graph.size == 0:
        raise GraphFormatError(f"{path}: no variables and no factors in it")
    if SE2 in graph.ids and SE3 in graph.ids:
        raise GraphFormatError(f"{path}: poses in the plane and in space; one file has one of them")
    if merging:
        merging.check(path, np.unique(np.concatenate(ids)))
    held = sorted({_number(path, graph, known, *each) for each in fixed})
    return GraphFile(
        graph,
        values,
        known,
        np.array(held, np.int64),
        merging.pairs(),
        tuple(np.concatenate(lines_of_kind[block.kind]) for block in graph.blocks),
        (*notes, *merging.notes()),
    )


def _sorted_lines(
    text: LogText, tags: Mapping[str, Tag], fix: str, merge: str
) -> tuple[dict[str, list[tuple[int, list[str]]]], list[tuple[int, int]], Merging]:
    """Return the words of the lines of each tag, ids that are fixed with their lines, and merged.

    Raises
    ------
    GraphFormatError
        If a tag is unknown, or an id is none.
    """
    path = text.path
    lines: dict[str, list[tuple[int, list[str]]]] = {}
    fixed: list[tuple[int, int]] = []
    merging = Merging()
    for number, line in enumerate(text.lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0] in tags:
            lines.setdefault(words[0], []).append((number, words))
        elif words[0] not in (fix, merge):
            known = [*tags, *filter(None, (fix, merge))]
            raise GraphFormatError(
                f"{path}:{number}: {words[0]!r}: unknown{nearest(words[0], known)}"
            )
        else:
            ids = [_id(path, number, words[0], word) for word in words[1:]]
            wanted = 2 if words[0] == merge else max(len(ids), 1)
            if len(ids) != wanted:
                raise GraphFormatError(
                    f"{path}:{number}: {words[0]}: found {len(ids)} ids, needed are {wanted}"
                )
            if words[0] == fix:
                fixed += [(number, each) for each in ids]
            else:
                merging.add(number, *ids)
    return lines, fixed, merging


def _id(path: Path, line: int, tag: str, word: str) -> int:
    """Return the id that a word is.

    Raises
    ------
    GraphFormatError
        If it is none.
    """
    number = id_of(word)
    if number is None:
        raise GraphFormatError(f"{path}:{line}: {tag}: id {word!r}: {_ID_NEEDED}")
    return number


_ID_NEEDED: Final = f"a whole number is needed, from {-_LARGEST_ID - 1} to {_LARGEST_ID}"


def id_of(word: str) -> int | None:
    """Return the id that a word is; None if it is no whole number of 64 bits."""
    if not _WHOLE.fullmatch(word):
        return None
    number = int(word)
    return number if -_LARGEST_ID - 1 <= number <= _LARGEST_ID else None


def _number(
    path: Path,
    graph: FactorGraph,
    known: dict[VariableKind, NDArray[np.bool_]],
    line: int,
    fixed: int,
) -> int:
    """Return the number of a variable that a line says is fixed."""
    where = f"{path}:{line}: {fixed} is to be fixed"
    found = []
    for kind, ids in graph.ids.items():
        row = int(np.searchsorted(ids, fixed))
        if row < len(ids) and ids[row] == fixed:
            found.append((kind, row))
    if not found:
        raise GraphFormatError(f"{where}: there is no such variable")
    if len(found) > 1:
        raise GraphFormatError(
            f"{where}: a pose and a point have this id; give one of them an id of its own"
        )
    kind, row = found[0]
    if not known[kind][row]:
        raise GraphFormatError(f"{where}: no line says where it is; it needs a vertex of its own")
    return graph.first(kind) + row


def _merged(rows: Rows, tag: Tag, merging: Merging) -> Rows:
    """Return rows with the ids of merged poses replaced, without factors between what is one."""
    if not merging:
        return rows
    if isinstance(tag.kind, FactorKind):
        ids = merging.renamed(rows.ids)
        keep = ids[:, 0] != ids[:, -1] if tag.ids > 1 else np.ones(len(ids), np.bool_)
        # Between one and the same from the beginning is an error of its own.
        keep |= rows.ids[:, 0] == rows.ids[:, -1]
        merging.left_out += int((~keep).sum())
    else:
        ids = rows.ids
        keep = merging.renamed(ids)[:, 0] == ids[:, 0]
    return Rows(ids[keep], rows.numbers[keep], rows.lines[keep], rows.path, rows.notes)


def _rows(path: Path, tag: Tag, lines: Sequence[tuple[int, list[str]]], notes: list[str]) -> Rows:
    """Return the lines of a tag as numbers."""
    begin, width = 1 + tag.ids, len(tag.columns)
    try:
        if any(len(words) != begin + width for _, words in lines):
            lines = [(n, _completed(words, begin + width, tag.defaults)) for n, words in lines]
        ids = np.array(
            list(map(int, chain.from_iterable(words[1:begin] for _, words in lines))), np.int64
        )
        numbers = np.array(
            list(map(float, chain.from_iterable(words[begin:] for _, words in lines))), np.float64
        )
        if not is_sound(numbers):
            raise ValueError
    except (ValueError, OverflowError):
        raise _first_error(path, tag, lines) from None
    return Rows(
        ids.reshape(len(lines), tag.ids),
        numbers.reshape(len(lines), width),
        np.array([number for number, _ in lines], np.int64),
        path,
        notes,
    )


def _completed(words: list[str], length: int, defaults: tuple[str, ...]) -> list[str]:
    """Return the words of a line, with the defaults where these are missing."""
    if defaults and len(words) == length - len(defaults):
        return [*words, *defaults]
    if len(words) != length:
        raise ValueError
    return words


def _first_error(path: Path, tag: Tag, lines: Iterable[tuple[int, list[str]]]) -> GraphFormatError:
    """Return what is wrong with the first wrong line."""
    begin = 1 + tag.ids
    for number, words in lines:
        wanted = begin + len(tag.columns)
        if len(words) not in (wanted, wanted - len(tag.defaults)):
            names = [f"id {i + 1}" for i in range(tag.ids)] if tag.ids > 1 else ["id"]
            return GraphFormatError(
                f"{path}:{number}: {words[0]}: found {len(words) - 1} words, needed are "
                f"{wanted - 1}: {', '.join([*names, *tag.columns])}"
            )
        for word in words[1:begin]:
            if id_of(word) is None:
                return GraphFormatError(f"{path}:{number}: {words[0]}: id {word!r}: {_ID_NEEDED}")
        for name, word in zip(tag.columns, words[begin:], strict=False):
            if not is_number(word) or not abs(float(word)) <= LARGEST:
                return GraphFormatError(
                    f"{path}:{number}: {words[0]}: {name} {word!r}: a finite number is needed, of "
                    f"at most {LARGEST:g} in size"
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


def variable_tag(
    columns: tuple[str, ...], kind: VariableKind, convert: Callable[[Rows], Floats]
) -> Tag:
    """Return the tag of variables, of which `convert` makes values."""

    def add(builder: GraphBuilder, rows: Rows) -> None:
        ids, counts = np.unique(rows.ids[:, 0], return_counts=True)
        for twice in ids[counts > 1][:1]:
            last = np.flatnonzero(rows.ids[:, 0] == twice)[1]
            rows.check(np.arange(len(rows.ids)) != last, f"{kind.name} {twice} is there already")
        builder.variables(kind, rows.ids[:, 0], convert(rows))

    return Tag(1, columns, add, kind)


def factor_tag(
    columns: tuple[str, ...],
    kind: FactorKind,
    split: Callable[[Rows], tuple[Floats, Floats]],
    defaults: tuple[str, ...] = (),
) -> Tag:
    """Return the tag of factors, of which `split` makes measurements and information."""

    def add(builder: GraphBuilder, rows: Rows) -> None:
        if len(kind.variables) == 2 and kind.variables[0] is kind.variables[1]:
            rows.check(rows.ids[:, 0] != rows.ids[:, 1], "links a variable with itself")
        measurements, information = split(rows)
        # The inverse of an inverse may be above by rounding.
        near = np.abs(information) <= LARGEST * (1.0 + 1e-9)
        information = np.where(near, np.clip(information, -LARGEST, LARGEST), information)
        rows.check(
            sound_rows(information), f"information above {LARGEST:g} follows from so small numbers"
        )
        builder.factors(kind, rows.ids, measurements, information)

    return Tag(len(kind.variables), columns, add, kind, defaults)


def lines_of(tag: str, ids: NDArray[np.int64], numbers: Floats) -> Iterator[str]:
    """Return lines of a tag, with all digits that the numbers have."""
    return (
        " ".join([tag, *map(str, own.tolist()), *map(repr, row.tolist())])
        for own, row in zip(ids, numbers, strict=True)
    )
