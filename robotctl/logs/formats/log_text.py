"""Text of recorded logs: lines with their numbers, from plain or gzip files, complete or cut.

A log is cut when a disk was full or a computer lost its power. Everything before the cut is good,
so a cut is a note and not an error: an incomplete last line that cannot be read is dropped. Damage
anywhere else is an error that names file and line.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from robotctl.errors import RobotctlError

_GZIP: Final = b"\x1f\x8b"
_HEAD_BYTES: Final = 1 << 16
_CHUNK_BYTES: Final = 1 << 16
_SHOWN: Final = 24
_LARGEST: Final = 2**63 - 1
_SOUND: Final = 20
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


class LogFormatError(RobotctlError):
    """A recorded log cannot be read; the message names file, line, what was found, what is allowed.

    Lines are counted from 1 in the text, also for a compressed file.
    """


@dataclass(frozen=True, slots=True)
class LogText:
    """The text of one file.

    Parameters
    ----------
    path
        Path of the file, for messages.
    lines
        Lines without their ends; line i of the file is `lines[i - 1]`.
    is_cut
        Whether the compressed data ended early.
    ends_open
        Whether the last line has no end, so that it may be cut.
    """

    path: Path
    lines: list[str]
    is_cut: bool
    ends_open: bool

    def error(self, line: int, problem: str) -> LogFormatError:
        """Return the error for a line, counted from 1."""
        return LogFormatError(f"{self.path}:{line}: {problem}")

    def is_open_end(self, line: int) -> bool:
        """Return whether this is the last line, possibly cut, so that it may be left out."""
        return self.ends_open and line == len(self.lines)

    def notes(self) -> tuple[str, ...]:
        """Return remarks on the text as a whole."""
        if not self.is_cut:
            return ()
        return (f"{self.path}: the compressed file is cut short after line {len(self.lines)}",)


def read_text(path: Path) -> LogText:
    """Read a log, plain or gzip by content.

    Raises
    ------
    LogFormatError
        If compressed data are damaged (not merely cut), or the file is not text.
    OSError
        If the file cannot be read.
    """
    raw = path.read_bytes()
    data, is_cut = raw, False
    if raw.startswith(_GZIP):
        data, is_cut, damage = inflated(raw)
        if damage:
            line = _first_odd(_decoded(data).split("\n"))
            raise LogFormatError(
                f"{path}:{line}: the gzip data are damaged, here or before: {damage}"
            )
    text = _decoded(data)
    if "\0" in text[:_HEAD_BYTES]:
        raise LogFormatError(f"{path}: is no text; a log is text, plain or gzip")
    lines = text.split("\n")
    ends_open = lines[-1] != ""
    if not ends_open:
        lines.pop()
    if is_cut and ends_open:
        lines.pop()
        ends_open = False
    return LogText(path, lines, is_cut, ends_open)


def first_words(path: Path) -> str:
    """Return the beginning of a text file, to detect its format; "" if it is not text.

    Raises
    ------
    LogFormatError
        If compressed data are damaged from the beginning.
    OSError
        If the file cannot be read.
    """
    with path.open("rb") as file:
        raw = file.read(_HEAD_BYTES)
    if raw.startswith(_GZIP):
        raw, _, damage = inflated(raw)
        if damage and not raw:
            raise LogFormatError(f"{path}:1: the gzip data are damaged: {damage}")
    text = _decoded(raw[:_HEAD_BYTES])
    return "" if "\0" in text else text


def first_row(path: Path) -> list[str]:
    """Return the words of the first line that is not a comment; raises as `first_words`."""
    for line in first_words(path).splitlines():
        words = line.split()
        if words and not words[0].startswith("#"):
            return words
    return []


def first_word(path: Path) -> str:
    """Return the first word of the first line that is not a comment; raises as `first_words`."""
    return next(iter(first_row(path)), "")


def _first_odd(lines: Sequence[str]) -> int:
    """Return the number of the first suspicious line of damaged data, else of the last.

    A suspicious line has a word that begins like a number without being one, or is of a new kind;
    words of the first lines are trusted.
    """
    known = {word for line in lines[:_SOUND] for word in line.split()}
    for number, line in enumerate(lines, 1):
        words = line.split()
        odd = [word for word in words if word[0] in "+-.0123456789" and not is_number(word)]
        if not known.issuperset(odd) or (
            words and not known.issuperset(words[:1]) and not is_number(words[0])
        ):
            return number
    return len(lines)


def _decoded(data: bytes) -> str:
    """Return text without its byte order mark; invalid bytes are replaced."""
    utf_16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    return data.decode("utf-16" if utf_16 else "utf-8-sig", errors="replace")


def inflated(raw: bytes) -> tuple[bytes, bool, str]:
    """Return the content of gzip data, of one or more members.

    Parameters
    ----------
    raw
        Data that begin as gzip.

    Returns
    -------
    content : bytes
        Content up to the end or the damage.
    is_cut : bool
        Whether the data end early.
    damage : str
        Error of the data; empty: none.
    """
    parts = []
    while raw.startswith(_GZIP):
        member = zlib.decompressobj(wbits=31)
        size = _CHUNK_BYTES
        for begin in range(0, len(raw), size):
            before = member.copy()
            try:
                parts.append(member.decompress(raw[begin : begin + size]))
            except zlib.error as error:
                parts.append(_up_to_damage(before, raw[begin : begin + size]))
                return b"".join(parts), False, str(error).rpartition(": ")[2]
            if member.eof:
                raw = member.unused_data + raw[begin + size :]
                break
        else:
            return b"".join(parts), True, ""
    return b"".join(parts), False, ""


def _up_to_damage(member: zlib._Decompress, raw: bytes) -> bytes:
    """Return the decompressed data before the damage, which is found byte by byte."""
    found = b""
    for at in range(len(raw)):
        try:
            found += member.decompress(raw[at : at + 1])
        except zlib.error:
            break
    return found


def integer(text: LogText, line: int, name: str, word: str) -> int:
    """Return the whole number in a word of a line.

    Raises
    ------
    LogFormatError
        If it is not one, or beyond 64 bits.
    """
    try:
        number = int(word)
    except ValueError:
        raise text.error(line, f"{name}: found {_shown(word)}, a whole number is needed") from None
    if abs(number) > _LARGEST:
        raise text.error(line, f"{name}: found {_shown(word)}, allowed are 64 bits")
    return number


def numbers(text: LogText, line: int, words: Sequence[str]) -> NDArray[np.float64]:
    """Return the numbers in the words of a line, (n,); nan and inf are numbers here.

    Raises
    ------
    LogFormatError
        If one of the words is not a number.
    """
    try:
        return np.array(list(map(float, words)))
    except ValueError:
        bad = next(word for word in words if not is_number(word))
        raise text.error(line, f"found {_shown(bad)}, a number is needed{hint(bad)}") from None


def table(text: LogText, columns: Sequence[str], skip: str = "#") -> NDArray[np.float64]:
    """Return a file of rows of finite numbers, (n, columns), without lines that begin with `skip`.

    Raises
    ------
    LogFormatError
        If a row has another number of columns, or a word is not a finite number. A last row that
        may be cut is left out instead.
    """
    kept = _rows(text, skip)
    if kept and text.is_open_end(kept[-1][0]) and not _is_row(kept[-1][1], len(columns)):
        kept.pop()
    try:
        if any(len(words) != len(columns) for _, words in kept):
            raise ValueError
        values = np.array(list(map(float, chain.from_iterable(words for _, words in kept))))
    except ValueError:
        raise _first_bad_row(text, kept, columns) from None
    if not np.all(np.isfinite(values)):
        raise _first_bad_row(text, kept, columns)
    return values.reshape(len(kept), len(columns))


def row_number(text: LogText, row: int, skip: str = "#") -> int:
    """Return the number of the line of a row of `table`."""
    return _rows(text, skip)[row][0]


def _rows(text: LogText, skip: str) -> list[tuple[int, list[str]]]:
    """Return the words of all lines that are rows, with the lines' numbers."""
    return [
        (number, words)
        for number, line in enumerate(text.lines, 1)
        if (words := line.split()) and not words[0].startswith(skip)
    ]


def _first_bad_row(
    text: LogText, rows: Sequence[tuple[int, list[str]]], columns: Sequence[str]
) -> LogFormatError:
    """Return the error of the first invalid row."""
    number, words = next((n, words) for n, words in rows if not _is_row(words, len(columns)))
    if len(words) != len(columns):
        problem = (
            f"found {len(words)} words, needed are {len(columns)}: {', '.join(columns)}"
            f"{hint(words[0])}"
        )
    else:
        column, word = next(
            (name, word) for name, word in zip(columns, words, strict=True) if not _is_finite(word)
        )
        problem = f"{column}: found {_shown(word)}, a finite number is needed{hint(word)}"
    return text.error(number, problem)


def _is_row(words: Sequence[str], columns: int) -> bool:
    """Return whether the words are the given number of finite numbers."""
    return len(words) == columns and all(map(_is_finite, words))


def is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _is_finite(word: str) -> bool:
    """Return whether a word is a finite number."""
    return is_number(word) and bool(np.isfinite(float(word)))


def hint(word: str) -> str:
    """Return what a word that is not a number resembles; empty if nothing known."""
    if ";" in word:
        return "; the columns are separated by ';', needed are spaces"
    if _DECIMAL_COMMA.fullmatch(word):
        return "; it has decimal commas, needed are points"
    return "; the columns are separated by commas, needed are spaces" if "," in word else ""


def _shown(word: str) -> str:
    """Return a word as shown in messages."""
    return repr(word if len(word) <= _SHOWN else f"{word[:_SHOWN]}...")
