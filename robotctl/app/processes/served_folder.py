"""Folders of the disk as ground stations see them over MAVLink FTP."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from robotctl.config.options import StackOptions
from robotctl.mavlink.ftp.files import Entry, Files
from robotctl.mavlink.ftp.payload import FtpError, FtpRefused

MOST_BYTES: Final = 64 << 20
"""Maximum size of all that ground stations keep on the robot's disk [B]."""
MOST_FILES: Final = 1000
"""Maximum number of their files; no file takes less than a block."""
FOLDER: Final = "files"
"""In the folder of what survives restarts; all else there is none of theirs."""
LOGS: Final = "@LOGS"


def served_folders(options: StackOptions) -> Mapping[str, Files]:
    """Return what ground stations may read and write: "" is the root, others folders in it."""
    found: dict[str, Files] = {}
    if options.state:
        found[""] = ServedFolder(Path(options.state) / FOLDER, writable=True)
    if options.record:
        found[LOGS] = ServedFolder(Path(options.record), writable=False)
    return found


@contextmanager
def _answered() -> Iterator[None]:
    """Turn what the system says into what a client is told."""
    try:
        yield
    except FileNotFoundError:
        raise FtpRefused(FtpError.FILE_NOT_FOUND) from None
    except FileExistsError:
        raise FtpRefused(FtpError.FILE_EXISTS) from None
    except PermissionError:
        raise FtpRefused(FtpError.FILE_PROTECTED) from None
    except (OSError, ValueError) as error:  # ValueError: a name that is none
        number = error.errno if isinstance(error, OSError) and error.errno else errno.EINVAL
        raise FtpRefused(FtpError.FAIL_ERRNO, number & 0xFF) from None


class _DiskFile:
    """An open file; without `folder` for reading only."""

    def __init__(self, descriptor: int, folder: ServedFolder | None) -> None:
        self._descriptor = descriptor
        self._folder = folder

    @property
    def size(self) -> int:
        """Present size [B]."""
        return os.fstat(self._descriptor).st_size

    def read(self, offset: int, size: int) -> bytes:
        """Return bytes."""
        with _answered():
            return os.pread(self._descriptor, size, offset)

    def write(self, offset: int, data: bytes) -> None:
        """Write bytes where there is room for them."""
        if self._folder is None:
            raise FtpRefused(FtpError.FILE_PROTECTED)
        self._folder.take_room(offset + len(data) - self.size)
        with _answered():
            os.pwrite(self._descriptor, data, offset)

    def close(self) -> None:
        """Bring what was written to the disk; `FtpRefused`: that does not take it."""
        try:
            with _answered():
                if self._folder is not None:
                    os.fsync(self._descriptor)
        finally:
            os.close(self._descriptor)


class ServedFolder:
    """A folder of the disk. Nothing outside can be reached, not by links either.

    Parameters
    ----------
    root
        The folder, which need not exist.
    writable
        Whether files may be made, changed and removed.
    """

    def __init__(self, root: Path, *, writable: bool) -> None:
        self._root = root
        self._writable = writable
        self._used = 0
        """Bytes of all files, as of the last that was made, and what was written since."""

    def list(self, path: str) -> Sequence[Entry]:
        """Return files and folders in a folder, sorted."""
        if not path and not self._root.exists():
            return ()
        with _answered(), os.scandir(self._at(path)) as found:
            return sorted(_entry(each) for each in found if not each.is_symlink())

    def open(self, path: str) -> _DiskFile:
        """Open a file for reading."""
        return _DiskFile(self._open(self._at(path), os.O_RDONLY), None)

    def create(self, path: str, *, empty: bool) -> _DiskFile:
        """Open a file for writing."""
        target = self._to_change(path)
        if not target.exists():
            self._begin()
        flags = os.O_RDWR | os.O_CREAT | (os.O_TRUNC if empty else 0)
        return _DiskFile(self._open(target, flags), self)

    def remove(self, path: str) -> None:
        """Remove a file."""
        with _answered():
            self._to_change(path).unlink()

    def make_folder(self, path: str) -> None:
        """Make a folder."""
        target = self._to_change(path)
        self._begin()
        with _answered():
            target.mkdir()

    def remove_folder(self, path: str) -> None:
        """Remove an empty folder."""
        with _answered():
            self._to_change(path).rmdir()

    def take_room(self, more: int) -> None:
        """Let a file grow by some bytes; `FtpRefused`: there is no room for them."""
        if more > 0:
            if self._used + more > MOST_BYTES:
                raise FtpRefused(FtpError.FAIL_ERRNO, errno.ENOSPC)
            self._used += more

    def _begin(self) -> None:
        """See what is used before something new is made; refuse it where there is too much."""
        with _answered():
            sizes = [each.lstat().st_size for each in self._root.rglob("*")]
        self._used = sum(sizes)
        if len(sizes) >= MOST_FILES:
            raise FtpRefused(FtpError.FAIL_ERRNO, errno.ENOSPC)

    def _to_change(self, path: str) -> Path:
        """Return the place of what is to be changed."""
        if not self._writable or not path:
            raise FtpRefused(FtpError.FILE_PROTECTED)
        with _answered():
            self._root.mkdir(parents=True, exist_ok=True)
        return self._at(path)

    def _at(self, path: str) -> Path:
        """Return the place of a path, which is in the folder."""
        target = self._root / path
        with _answered():
            if not target.resolve().is_relative_to(self._root.resolve()):
                raise FtpRefused(FtpError.FILE_NOT_FOUND)
        return target

    def _open(self, target: Path, flags: int) -> int:
        """Return the descriptor of a regular file; a fifo is not waited for."""
        with _answered():
            found = os.open(target, flags | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
            if not stat.S_ISREG(os.fstat(found).st_mode):
                os.close(found)
                raise FtpRefused(FtpError.FILE_NOT_FOUND)
            return found


def _entry(found: os.DirEntry[str]) -> Entry:
    if found.is_dir(follow_symlinks=False):
        return Entry(found.name, None)
    status = found.stat(follow_symlinks=False)
    return Entry(found.name, status.st_size, round(status.st_mtime))
