"""Electronic data sheets (CiA 306): which objects a drive has, and what its PDOs carry by default.

Only what the driver needs is read; the rest of a file may be as wrong as it likes.
"""

from __future__ import annotations

import configparser
import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import robotctl
from robotctl.errors import InvalidValue

Key: TypeAlias = tuple[int, int]
"""Index and sub-index of an object."""

_SECTION: Final = re.compile(r"([0-9A-F]{4})(?:SUB([0-9A-F]{1,2}))?")
_BITS: Final = {1: 1, 2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32}
"""Length of a data type [bit], by its number in CiA 301, table 44."""


class EdsObject(NamedTuple):
    """One object: whether it can be written, its length [bit] (0: unknown), and its default."""

    writable: bool
    bits: int
    default: int | None


@dataclass(frozen=True, slots=True)
class Eds:
    """Part of an electronic data sheet.

    Parameters
    ----------
    vendor, product
        As object 1018h must have them; 0: the file does not say.
    objects
        All objects, by index and sub-index.
    """

    vendor: int
    product: int
    objects: Mapping[Key, EdsObject]

    def has(self, index: int, subindex: int = 0) -> bool:
        """Return whether the drive has an object."""
        return (index, subindex) in self.objects

    def can_write(self, index: int, subindex: int = 0) -> bool:
        """Return whether the drive has an object that a client may write."""
        found = self.objects.get((index, subindex))
        return found is not None and found.writable

    def default(self, index: int, subindex: int = 0) -> int | None:
        """Return the default of an object; None if there is none."""
        found = self.objects.get((index, subindex))
        return None if found is None else found.default


def find_eds(name: str) -> Path:
    """Return the file of a name: as given, else among the configurations that come with robotctl.

    Raises
    ------
    InvalidValue
        There is no such file.
    """
    package = Path(robotctl.__file__).resolve().parent
    places = (Path(), package / "configs", package.parent / "configs")
    for place in places:
        if (path := place / name).is_file():
            return path
    raise InvalidValue("eds", f"must name an EDS; no file {name!r} found", name)


@functools.cache
def load_eds(path: Path) -> Eds:
    """Read an EDS.

    Raises
    ------
    InvalidValue
        If it cannot be read, or describes no object.
    """
    parser = configparser.ConfigParser(interpolation=None, strict=False, delimiters=("=",))
    try:
        parser.read_string(path.read_text(encoding="latin-1"))
    except (OSError, configparser.Error) as error:
        raise InvalidValue("eds", f"must be an EDS (CiA 306): {path}: {error}", str(path)) from None
    sections = {name.upper(): parser[name] for name in parser.sections()}
    objects: dict[Key, EdsObject] = {}
    for name, section in sections.items():
        match = _SECTION.fullmatch(name)
        if match is None:
            continue
        index, sub = int(match[1], 16), int(match[2] or "0", 16)
        if match[2] is None and int(_number(section.get("SubNumber")) or 0) > 0:
            continue  # a record or an array: its members have sections of their own
        found = EdsObject(
            section.get("AccessType", "").strip().lower() in {"rw", "rww", "rwr", "wo"},
            _BITS.get(_number(section.get("DataType")) or 0, 0),
            _number(section.get("DefaultValue")),
        )
        members = _number(section.get("CompactSubObj")) or 0
        for member in range(sub, sub + members + 1):
            objects.setdefault((index, member), found)
    if not objects:
        raise InvalidValue("eds", f"must describe objects; {path} describes none", str(path))
    info = sections.get("DEVICEINFO")
    return Eds(
        (_number(info.get("VendorNumber")) or 0) if info is not None else 0,
        (_number(info.get("ProductNumber")) or 0) if info is not None else 0,
        objects,
    )


def _number(text: str | None) -> int | None:
    """Return a number as CiA 306 writes it; None if there is none, or it depends on the node id."""
    try:
        return int(text or "", 0)
    except ValueError:
        return None
