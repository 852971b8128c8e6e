"""Files in which plans of ground stations and of the page outlive a power cut."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeAlias
from zlib import crc32

import msgspec

from robotctl.errors import DiskError
from robotctl.messages.fence import FenceFile, RallyFile, SetFence, SetRally
from robotctl.messages.plans import SetZones, ZonesFile
from robotctl.runtime.storage.atomic_file import write_whole

Bounds: TypeAlias = SetFence | SetRally | SetZones

ENDINGS: Final = {"mission": "toml", "fence": "json", "rally points": "json", "zones": "json"}
"""Endings of the files of each kind."""

_BOUNDS: Final[dict[str, tuple[type[Any], Callable[[Any, int], Bounds]]]] = {
    "fence": (FenceFile, lambda file, crc: SetFence(0, file.fence, crc)),
    "rally points": (RallyFile, lambda file, crc: SetRally(0, file.places, crc)),
    "zones": (ZonesFile, lambda file, crc: SetZones(0, file.zones, crc)),
}
"""Content of each file, and the request that it is from its start."""


class PlanFiles:
    """Keeps the plans of one kind in a folder; "": nowhere.

    A file's name has the CRC-32 of its content: while navigation decides on a new one there are
    two.

    Parameters
    ----------
    directory
        The folder.
    kind
        One of `ENDINGS`.
    """

    def __init__(self, directory: str, kind: str) -> None:
        self._folder = Path(directory).resolve() if directory else None
        self._kind = kind

    def _name(self, word: str) -> str:
        origin = "page" if self._kind == "zones" else "mavlink"
        return f"{origin}-{self._kind.replace(' ', '-')}-{word}.{ENDINGS[self._kind]}"

    def _files(self) -> list[Path]:
        """Return all there are, the oldest first."""
        found = [] if self._folder is None else self._folder.glob(self._name("*"))
        return sorted(found, key=lambda file: file.stat().st_mtime_ns)

    def read(self) -> bytes:
        """Return the last plan that was kept; empty: none was. `OSError`: it cannot be read."""
        files = self._files()
        return files[0].read_bytes() if files else b""

    def load(self) -> bytes:
        """Return the last plan that was kept; empty: none was, or it cannot be read."""
        try:
            return self.read()
        except OSError:
            return b""

    def save(self, content: bytes) -> str:
        """Save a file beside the present one; return its path, empty: it is not kept."""
        if self._folder is None:
            return ""
        file = self._folder / self._name(f"{crc32(content):08x}")
        try:
            if not file.exists():
                write_whole(file, content)
        except OSError:
            return ""
        return str(file)

    def keep(self, content: bytes) -> None:
        """Remove all that was saved but this."""
        name = self._name(f"{crc32(content):08x}")
        with suppress(OSError):
            for file in self._files():
                if file.name != name:
                    file.unlink()


def plan_stores(directory: str) -> dict[str, PlanFiles]:
    """Return what keeps each kind of plans in a folder; "": nowhere."""
    return {kind: PlanFiles(directory, kind) for kind in ENDINGS}


def load_bounds(directory: str, kind: str) -> tuple[Bounds, ...]:
    """Return the fence, rally points or zones that a robot of this folder starts with: one or none.

    Parameters
    ----------
    directory
        Folder of the plans; "": there is none.
    kind
        "fence", "rally points" or "zones".

    Raises
    ------
    DiskError
        If the file is damaged, or cannot be read.
    """
    form, request = _BOUNDS[kind]
    try:
        content = PlanFiles(directory, kind).read()
        if not content:
            return ()
        return (request(msgspec.json.decode(content, type=form), crc32(content)),)
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise DiskError(f"{directory}: the {kind} cannot be read, upload anew: {error}") from error
