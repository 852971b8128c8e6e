"""Non-volatile memory of a node: a JSON file with a checksum, replaced atomically."""

from __future__ import annotations

import json
import os
import tempfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from firmware_sim.nodes.variables import Key


class StoreDamagedError(Exception):
    """Stored parameters exist but cannot be trusted."""


class ParameterStore(Protocol):
    """Keeps the parameters of one node over a power cycle."""

    def load(self) -> dict[Key, int]:
        """Return the stored data, empty if none; raises `StoreDamagedError`."""

    def save(self, values: dict[Key, int]) -> None:
        """Replace the stored data; raises OSError and keeps the old."""

    def clear(self) -> None:
        """Clear the store, so that the next start uses defaults."""


class MemoryStore:
    """A store that lives as long as the process."""

    def __init__(self) -> None:
        self._values: dict[Key, int] = {}

    def load(self) -> dict[Key, int]:
        """Return what was stored."""
        return dict(self._values)

    def save(self, values: dict[Key, int]) -> None:
        """Replace the content."""
        self._values = dict(values)

    def clear(self) -> None:
        """Clear the store."""
        self._values = {}


class FragileStore:
    """A store whose content can be damaged until it is written again.

    Parameters
    ----------
    store
        Store of the parameters.
    """

    def __init__(self, store: ParameterStore) -> None:
        self._store = store
        self.damaged = False

    def load(self) -> dict[Key, int]:
        """Return what was stored; raises StoreDamagedError if it is damaged."""
        if self.damaged:
            raise StoreDamagedError("the checksum does not match")
        return self._store.load()

    def save(self, values: dict[Key, int]) -> None:
        """Replace the content, which is then sound."""
        self._store.save(values)
        self.damaged = False

    def clear(self) -> None:
        """Clear the store, which is then sound."""
        self._store.clear()
        self.damaged = False


class FileStore:
    """A store in the file `directory`/`name`.json.

    The file holds the values by address in hexadecimal and the CRC-32 of their canonical JSON text.
    A new one is written beside it, flushed to the disk and renamed over it, so that a crash leaves
    either the old or the new parameters.

    Parameters
    ----------
    directory
        The state directory; made, private to the user, on the first `save`.
    name
        Name of the node.
    """

    def __init__(self, directory: Path, name: str) -> None:
        self.path = directory / f"{name}.json"

    def load(self) -> dict[Key, int]:
        """Return what was stored, empty if there is no file.

        Raises
        ------
        StoreDamagedError
            If the file cannot be read, is no such JSON, or does not match its checksum.
        """
        try:
            document = json.loads(self.path.read_bytes())
            values = document["values"]
            intact = document["crc32"] == _checksum(values)
            parsed = {_key(address): _integer(value) for address, value in values.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise StoreDamagedError(f"{self.path}: {error}") from error
        if not intact:
            raise StoreDamagedError(f"{self.path}: the checksum does not match")
        return parsed

    def save(self, values: dict[Key, int]) -> None:
        """Replace the file atomically and durably; OSError leaves the old one."""
        named = {f"{index:04X}:{sub:02X}": value for (index, sub), value in values.items()}
        document = {"values": named, "crc32": _checksum(named)}
        directory = self.path.parent
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(prefix=f".{self.path.name}.", dir=directory)
        try:
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                json.dump(document, file, indent=1)
                file.flush()
                os.fsync(file.fileno())
            Path(temporary).replace(self.path)
        except OSError:
            with suppress(OSError):
                Path(temporary).unlink()
            raise
        _sync_directory(directory)

    def clear(self) -> None:
        """Remove the file."""
        self.path.unlink(missing_ok=True)
        if self.path.parent.is_dir():
            _sync_directory(self.path.parent)


def _checksum(values: dict[str, int]) -> int:
    return zlib.crc32(json.dumps(values, sort_keys=True, separators=(",", ":")).encode("ascii"))


def _key(address: str) -> Key:
    index, sub_index = address.split(":")
    return int(index, 16), int(sub_index, 16)


def _integer(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{value!r} is no integer")
    return value


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
