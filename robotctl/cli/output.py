"""The standard output and error of a command: what they cannot take costs nothing but the text.

A robot drives on, a map is written and a status is kept, whether or not the output is read.
"""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from typing import Any, Final, TextIO, cast

_PLAIN: Final = {
    "°": " deg", "µ": "u", "μ": "u", "×": "x", "·": "-", "…": "...", "–": "-", "—": "-",
    "±": "+-", "≤": "<=", "≥": ">=", "→": "->", "²": "2", "³": "3", "σ": "sigma", "α": "alpha",
    "ρ": "rho", "•": "*", "✓": "ok", "✗": "x", "─": "-", "━": "-", "│": "|", "┃": "|",
    "\u2212": "-",
}  # fmt: skip
"""Replacements for characters that the encoding lacks; others become `?`."""


def _plainly(error: UnicodeError) -> tuple[str | bytes, int]:
    """Return what to encode in place of a character, as the codecs ask; names keep their bytes."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    character = error.object[error.start]
    if "\udc80" <= character <= "\udcff":  # a byte of a file's name that is no UTF-8
        return bytes([ord(character) - 0xDC00]), error.start + 1
    return _PLAIN.get(character, "?"), error.start + 1


def _escaped(error: UnicodeError) -> tuple[str | bytes, int]:
    r"""Return as `_plainly`, but bytes of names as Python shows them in errors: `\udce9`."""
    what, behind = _plainly(error)
    return f"\\udc{what[0]:02x}" if isinstance(what, bytes) else what, behind


codecs.register_error("plainly", _plainly)
codecs.register_error("plainly, escaped", _escaped)


class Output:
    """A text stream that silently discards output once it cannot be written.

    Parameters
    ----------
    stream
        The standard output or the standard error.
    """

    def __init__(self, stream: TextIO) -> None:
        if isinstance(stream, TextIOWrapper):
            is_of_errors = stream.errors == "backslashreplace"
            stream.reconfigure(errors="plainly, escaped" if is_of_errors else "plainly")
        self._stream = stream
        self.failure: OSError | None = None
        """Why the rest is not written."""

    def __getattr__(self, name: str) -> Any:
        """Return what the stream has beside: its encoding, descriptor, buffer."""
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, or do nothing."""
        try:
            self._stream.write(text)
        except OSError as error:
            self._give_up(error)
        return len(text)

    def flush(self) -> None:
        """Write what waits, or do nothing."""
        try:
            self._stream.flush()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        """Lead the rest nowhere; the interpreter would try what waits again at its end."""
        self.failure = self.failure or error
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


@contextmanager
def quiet_output() -> Iterator[Output]:
    """Put an `Output` in the place of the standard output, which is yielded, and of the error.

    One that is closed leads nowhere; its descriptor must not be that of the next file opened.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest that is free: this
    before = sys.stdout, sys.stderr
    output = Output(sys.stdout or os.fdopen(1, "w", closefd=False))
    errors = Output(sys.stderr or os.fdopen(2, "w", closefd=False))
    sys.stdout, sys.stderr = cast("TextIO", output), cast("TextIO", errors)
    try:
        yield output
        output.flush()
    finally:
        errors.flush()
        sys.stdout, sys.stderr = before
