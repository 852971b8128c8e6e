"""The files that are served: folders, and what looks like one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from robotctl.mavlink.ftp.payload import FtpError, FtpRefused


class Entry(NamedTuple):
    """A name in a folder."""

    name: str
    size: int | None
    """None: it is a folder itself."""
    modified_s: int = 0
    """When a file of the disk was changed last [s since 1970]; 0: it is none."""


class OpenFile(Protocol):
    """An open file."""

    @property
    def size(self) -> int:
        """Present size [B]."""

    def read(self, offset: int, size: int) -> bytes:
        """Return bytes; fewer only at its end."""

    def write(self, offset: int, data: bytes) -> None:
        """Write bytes; `FtpRefused`: it may only be read, or there is no room."""

    def close(self) -> None:
        """End it; what was written is on the disk then, or `FtpRefused`."""


class Files(Protocol):
    """A tree of files. Paths have no slash at their ends, "" is the root; all may refuse."""

    def list(self, path: str) -> Sequence[Entry]:
        """Return what is in a folder, sorted."""

    def open(self, path: str) -> OpenFile:
        """Open a file for reading."""

    def create(self, path: str, *, empty: bool) -> OpenFile:
        """Open a file for writing, a new one if there is none; an old one emptied or as it is."""

    def remove(self, path: str) -> None:
        """Remove a file."""

    def make_folder(self, path: str) -> None:
        """Make a folder."""

    def remove_folder(self, path: str) -> None:
        """Remove an empty folder."""


class Content:
    """A file in memory that may be read."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @property
    def size(self) -> int:
        """Size [B]."""
        return len(self._data)

    def read(self, offset: int, size: int) -> bytes:
        """Return bytes."""
        return self._data[offset : offset + size]

    def write(self, offset: int, data: bytes) -> None:  # noqa: ARG002
        """Refuse."""
        raise FtpRefused(FtpError.FILE_PROTECTED)

    def close(self) -> None:
        """Have nothing to do."""


class NoFiles:
    """An empty folder to which nothing can be added."""

    def list(self, path: str) -> Sequence[Entry]:
        """Return nothing."""
        if path:
            raise FtpRefused(FtpError.FILE_NOT_FOUND)
        return ()

    def open(self, path: str) -> OpenFile:  # noqa: ARG002
        """Find nothing."""
        raise FtpRefused(FtpError.FILE_NOT_FOUND)

    def create(self, path: str, *, empty: bool) -> OpenFile:  # noqa: ARG002
        """Refuse."""
        raise FtpRefused(FtpError.FILE_PROTECTED)

    def remove(self, path: str) -> None:  # noqa: ARG002
        """Refuse."""
        raise FtpRefused(FtpError.FILE_PROTECTED)

    make_folder = remove_folder = remove


class Mounted:
    """One tree with others at folders of its root.

    Parameters
    ----------
    root
        What is at the root.
    mounts
        Other trees, by the name of their folder.
    """

    def __init__(self, root: Files, mounts: Mapping[str, Files]) -> None:
        self._root = root
        self._mounts = mounts

    def _find(self, path: str) -> tuple[Files, str]:
        """Return the tree of a path, and the path in that."""
        parts = [part for part in path.split("/") if part]
        if "\0" in path or any(part in {".", ".."} for part in parts):
            raise FtpRefused(FtpError.FILE_NOT_FOUND)
        if parts and parts[0] in self._mounts:
            return self._mounts[parts[0]], "/".join(parts[1:])
        return self._root, "/".join(parts)

    def list(self, path: str) -> Sequence[Entry]:
        """Return what is in a folder, sorted."""
        tree, below = self._find(path)
        found = list(tree.list(below))
        if tree is self._root and not below:
            found += [Entry(name, None) for name in self._mounts]
        return sorted(found)

    def open(self, path: str) -> OpenFile:
        """Open a file for reading."""
        tree, below = self._find(path)
        return tree.open(below)

    def create(self, path: str, *, empty: bool) -> OpenFile:
        """Open a file for writing."""
        tree, below = self._find(path)
        return tree.create(below, empty=empty)

    def remove(self, path: str) -> None:
        """Remove a file."""
        tree, below = self._find(path)
        tree.remove(below)

    def make_folder(self, path: str) -> None:
        """Make a folder."""
        tree, below = self._find(path)
        tree.make_folder(below)

    def remove_folder(self, path: str) -> None:
        """Remove an empty folder."""
        tree, below = self._find(path)
        tree.remove_folder(below)
