"""State that survives restarts and power cuts: small values in files written atomically.

A save writes a new file, syncs it, makes the present file the previous generation and puts the new
one in its place. After a kill or a power cut at any time, `load` returns the old value or the new
one, never a mixture. A file is one line of heading (format,
length and CRC-32 of the rest) and the value as JSON, so that people can read it.

Saving waits for the disk: never in the control process.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Final, Generic, Protocol, TypeVar

import msgspec

from robotctl.errors import RobotctlError

T = TypeVar("T", bound=msgspec.Struct)

_HEADING: Final = b"robotctl-state 1 "
_READ_LIMIT: Final = 1 << 20


class StateError(RobotctlError):
    """A state file cannot be read or written."""


class FileSystem(Protocol):
    """The part of module `os` used by state files; tests replace it to inject failures."""

    def open(self, path: Path, flags: int, mode: int = ..., /) -> int:
        """As `os.open`."""

    def read(self, fd: int, length: int, /) -> bytes:
        """As `os.read`."""

    def write(self, fd: int, data: bytes, /) -> int:
        """As `os.write`; may write less than asked for."""

    def fsync(self, fd: int, /) -> None:
        """As `os.fsync`."""

    def close(self, fd: int, /) -> None:
        """As `os.close`."""

    def rename(self, source: Path, target: Path, /) -> None:
        """As `os.rename`: replaces the target."""

    def listdir(self, path: Path, /) -> list[str]:
        """As `os.listdir`."""


def damaged_name(name: str, taken: Collection[str], why: str = "damaged") -> str:
    """Return a name not in `taken` under which a damaged file is set aside."""
    number = 1
    while (free := f"{name}.{why}-{number}") in taken:
        number += 1
    return free


class StateFile(Generic[T]):
    """One value on disk, with one previous generation.

    Parameters
    ----------
    path
        Path of the file; its folder must exist. Beside it are `NAME.previous` and, while saving,
        `NAME.new`. A damaged file becomes `NAME.damaged-1` and so on, and is never removed.
    kind
        Type of the value, a `msgspec.Struct`.
    system
        File system to use.
    """

    def __init__(self, path: Path, kind: type[T], system: FileSystem = os) -> None:
        self.path = path
        self._previous = path.with_name(f"{path.name}.previous")
        self._new = path.with_name(f"{path.name}.new")
        self._decoder = msgspec.json.Decoder(kind)
        self._system = system

    def load(self) -> tuple[T | None, tuple[str, ...]]:
        """Return the newest complete value, and a sentence for each file that was set aside.

        None if there never was a value, or no generation is complete.

        Raises
        ------
        StateError
            If the disk cannot be read, or a damaged file cannot be set aside. Neither is a reason
            to start with nothing, or with an old value that the next save would make permanent.
        """
        notes: list[str] = []
        for path in (self.path, self._previous):
            try:
                content = self._content(path)
                if content is None:
                    continue
            except OSError as error:
                raise StateError(f"{path}: cannot be read: {error.strerror}") from error
            try:
                return self._value(content), tuple(notes)
            except ValueError as error:
                damage = f"{path}: damaged ({error})"
            try:
                notes.append(f"{damage}; set aside as {self._set_aside(path)}")
            except OSError as error:
                raise StateError(f"{damage}, cannot be set aside: {error.strerror}") from error
        return None, tuple(notes)

    def save(self, value: T) -> None:
        """Replace the value on disk; returns when it would survive a power cut.

        Raises
        ------
        StateError
            If the disk refuses; the previous value stays.
        """
        body = msgspec.json.encode(value) + b"\n"
        content = _HEADING + f"{len(body)} {zlib.crc32(body):08x}\n".encode() + body
        system = self._system
        try:
            # At every moment one complete value exists under one of the names; a rename lasts only
            # once the folder is synced.
            self._write(self._new, content)
            with suppress(FileNotFoundError):  # the first save, or one that was interrupted here
                system.rename(self.path, self._previous)
            system.rename(self._new, self.path)
            self._sync_folder()
        except OSError as error:
            raise StateError(f"{self.path}: cannot be written: {error.strerror}") from error

    def _write(self, path: Path, content: bytes) -> None:
        """Write a file and sync it."""
        system = self._system
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        descriptor = system.open(path, flags, 0o644)
        try:
            while content:
                content = content[system.write(descriptor, content) :]
            system.fsync(descriptor)
        finally:
            system.close(descriptor)

    def _sync_folder(self) -> None:
        """Sync the folder."""
        system = self._system
        descriptor = system.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC, 0)
        try:
            system.fsync(descriptor)
        finally:
            system.close(descriptor)

    def _content(self, path: Path) -> bytes | None:
        """Return the content of a file, nothing for a fifo; None if it is missing."""
        system = self._system
        flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK  # a fifo is not waited for
        try:
            descriptor = system.open(path, flags, 0)
        except FileNotFoundError:
            return None
        try:
            parts = []
            while part := system.read(descriptor, _READ_LIMIT):
                parts.append(part)
            return b"".join(parts)
        finally:
            system.close(descriptor)

    def _value(self, content: bytes) -> T:
        """Return the value in a file.

        Raises
        ------
        ValueError
            If it is not exactly as saved, or of another kind.
        """
        heading, _, body = content.partition(b"\n")
        if not heading.startswith(_HEADING):
            raise ValueError("it does not begin as a state file")
        words = heading[len(_HEADING) :].split()
        if len(words) != 2 or words[0] != b"%d" % len(body):
            raise ValueError(f"its length is {len(body)} bytes, unlike its header")
        if words[1] != b"%08x" % zlib.crc32(body):
            raise ValueError("its checksum is wrong")
        return self._decoder.decode(body)  # a DecodeError is a ValueError

    def _set_aside(self, path: Path) -> Path:
        """Rename a damaged file to a free name."""
        taken = self._system.listdir(path.parent)
        target = path.with_name(damaged_name(self.path.name, taken))
        self._system.rename(path, target)
        self._sync_folder()
        return target
