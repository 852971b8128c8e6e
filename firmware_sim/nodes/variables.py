"""Entries of an object dictionary: typed variables with access rights and ranges."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

Value: TypeAlias = int | str
Key: TypeAlias = tuple[int, int]
"""Index and sub-index."""


class AbortCode(enum.IntEnum):
    """SDO abort codes (CiA 301, table 22)."""

    TOGGLE = 0x05030000
    COMMAND = 0x05040001
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    HARDWARE = 0x06060000
    LENGTH = 0x06070010
    NO_SUB_INDEX = 0x06090011
    RANGE = 0x06090030
    TRANSFER = 0x08000020
    DEVICE_STATE = 0x08000022
    NO_DATA = 0x08000024


class SdoAbortError(Exception):
    """An access that the dictionary refuses; `code` goes to the client."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(f"SDO abort 0x{code:08X} ({code.name.lower()})")
        self.code = code


class DataType(enum.IntEnum):
    """Data types in use, with their numbers of CiA 301, table 44."""

    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    VISIBLE_STRING = 0x09
    UNSIGNED64 = 0x1B


_SIGNED = frozenset({DataType.INTEGER8, DataType.INTEGER16, DataType.INTEGER32})
_SIZE = {
    DataType.INTEGER8: 1,
    DataType.INTEGER16: 2,
    DataType.INTEGER32: 4,
    DataType.UNSIGNED8: 1,
    DataType.UNSIGNED16: 2,
    DataType.UNSIGNED32: 4,
    DataType.UNSIGNED64: 8,
}


class Access(enum.StrEnum):
    """Access rights as the EDS writes them."""

    CONST = "const"
    RO = "ro"
    RW = "rw"
    WO = "wo"

    @property
    def readable(self) -> bool:
        """Whether an SDO client may read."""
        return self is not Access.WO

    @property
    def writable(self) -> bool:
        """Whether an SDO client may write."""
        return self in {Access.RW, Access.WO}


class Kind(enum.IntEnum):
    """Object codes of CiA 301, table 42."""

    VAR = 7
    ARRAY = 8
    RECORD = 9


@dataclass(frozen=True, slots=True)
class Variable:
    """One value of the dictionary.

    `low` and `high` bound the values that a client may write (None: the type's); a `stored` one
    survives a power cycle after "save"; a `mappable` one is carried by a PDO.
    """

    index: int
    sub_index: int
    name: str
    data_type: DataType
    access: Access
    default: Value
    low: int | None = None
    high: int | None = None
    stored: bool = False
    mappable: bool = False

    @property
    def key(self) -> Key:
        """Index and sub-index."""
        return self.index, self.sub_index

    @property
    def size(self) -> int | None:
        """Length on the wire in bytes; None for a string."""
        return _SIZE.get(self.data_type)

    def to_bytes(self, value: Value) -> bytes:
        """Return `value` as SDO transfers it."""
        if isinstance(value, str):
            return value.encode("ascii")
        return value.to_bytes(self.size or 0, "little", signed=self.data_type in _SIGNED)

    def from_bytes(self, data: bytes) -> Value:
        """Return the value of SDO data.

        Raises
        ------
        SdoAbortError
            LENGTH for a size other than the type's, RANGE outside `low`..`high`.
        """
        if self.size is None:
            return data.decode("ascii", "replace")
        if len(data) != self.size:
            raise SdoAbortError(AbortCode.LENGTH)
        value = int.from_bytes(data, "little", signed=self.data_type in _SIGNED)
        self.check_range(value)
        return value

    def check_range(self, value: int) -> None:
        """Raise `SdoAbortError` RANGE for a written value outside `low`..`high`."""
        too_low = self.low is not None and value < self.low
        if too_low or (self.high is not None and value > self.high):
            raise SdoAbortError(AbortCode.RANGE)


@dataclass(frozen=True, slots=True)
class Object:
    """One index of the dictionary with its variables."""

    index: int
    name: str
    kind: Kind
    variables: tuple[Variable, ...]


def variable(
    index: int,
    name: str,
    data_type: DataType,
    access: Access,
    default: Value,
    *,
    low: int | None = None,
    high: int | None = None,
    stored: bool = False,
    mappable: bool = False,
) -> Object:
    """Return an object that is one variable at sub-index 0."""
    only = Variable(index, 0, name, data_type, access, default, low, high, stored, mappable)
    return Object(index, name, Kind.VAR, (only,))


@dataclass(frozen=True, slots=True)
class Member:
    """A member of a record or array, in the order of the sub-indices from 1 on."""

    name: str
    data_type: DataType
    access: Access
    default: Value
    low: int | None = None
    high: int | None = None
    stored: bool = False


def compound(
    index: int,
    name: str,
    kind: Kind,
    members: Iterable[Member],
    *,
    count_name: str = "Highest sub-index supported",
    count_access: Access = Access.CONST,
    count: int | None = None,
) -> Object:
    """Return a record or array: sub-index 0 (the count) followed by `members`."""
    variables = [
        Variable(index, sub, m.name, m.data_type, m.access, m.default, m.low, m.high, m.stored)
        for sub, m in enumerate(members, start=1)
    ]
    default = len(variables) if count is None else count
    head = Variable(index, 0, count_name, DataType.UNSIGNED8, count_access, default)
    return Object(index, name, kind, (head, *variables))
