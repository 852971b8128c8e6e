"""Changes to a valid file, told by a few bytes: what a fuzzer invents instead of whole files.

The first byte of an input chooses the file, then each change has a kind, a place, and a size or a
choice; so inputs of some ten bytes reach deep into files of kilobytes.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from typing import Final

LONGEST: Final = 128
"""Bytes of an input: some 25 changes."""

_NUMBERS: Final = tuple(
    struct.pack(form, value)
    for form, values in {
        "<B": (0, 1, 0x7F, 0xFF),
        "<H": (0, 0xFFFF),
        "<I": (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF),
        "<Q": (0, 1, 1 << 31, 1 << 60, (1 << 63) - 1, 1 << 63, (1 << 64) - 1),
        "<f": (float("nan"), float("inf"), -1.0, 1e38),
        "<d": (float("nan"), float("-inf"), -1.0, 1e300),
    }.items()
    for value in values
)
_WORDS: Final = (
    b"", b"0", b"-1", b"1", b"nan", b"inf", b"-inf", b"1e999", b"1e300", b"-0.0", b"0x10", b"1_0",
    b"99999999", b"99999999999999999999", b"-9223372036854775808", b"true", b"null", b"'", b'"',
    b"[", b"{", b"]", b"}", b"#", b"\0", b"\xff\xfe", b"\n", b"a" * 40, b"[[", b"1979-05-27",
    b"../..",
    "\u0663".encode(), b"9" * 5000, b"9" * 400, b"[" * 3000,
)  # fmt: skip
_WORD: Final = re.compile(rb"[\w.+-]+")


def edited(data: bytes, files: Sequence[bytes]) -> bytes:
    """Return one of some files with the changes that an input tells."""
    if not data:
        return files[0]
    content, rest = bytearray(files[data[0] % len(files)]), data[1:]
    while len(rest) >= 4:
        kind, size = rest[0] % 7, rest[3]
        at = int.from_bytes(rest[1:3], "little") * (len(content) + 1) >> 16
        rest = rest[4:]
        if kind < 2:
            new, rest = rest[: size % 16], rest[size % 16 :]
            content[at : at + (len(new) if kind else 0)] = new
        elif kind == 2:
            del content[at : at + size]
        elif kind == 3:
            del content[at:]
        elif kind == 4:
            new = _NUMBERS[size % len(_NUMBERS)]
            content[at : at + len(new)] = new
        elif kind == 5:
            _replace_word(content, at, _WORDS[size % len(_WORDS)])
        else:
            content[at:at] = content[at : at + size]
    return bytes(content)


def _replace_word(content: bytearray, at: int, new: bytes) -> None:
    """Put another word in place of the next from a place on."""
    word = _WORD.search(content, at)
    if word is not None:
        content[word.start() : word.end()] = new
