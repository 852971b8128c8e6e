"""Object dictionary of a node and the rules for access to it (CiA 301, 7.4)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from firmware_sim.nodes.variables import AbortCode, Key, Object, SdoAbortError, Value, Variable


class ObjectDictionary:
    """The values of one node, with the rules for access over SDO.

    Parameters
    ----------
    objects
        All objects of the node; every value starts at its default.
    """

    def __init__(self, objects: Iterable[Object]) -> None:
        self._objects = {each.index: each for each in objects}
        self._variables = {v.key: v for o in self._objects.values() for v in o.variables}
        self._values: dict[Key, Value] = {}
        self._readers: dict[Key, Callable[[], Value]] = {}
        self._writers: dict[Key, Callable[[int], None]] = {}
        self.is_locked: Callable[[], bool] = lambda: False
        """Whether writes by clients are refused now."""
        self.reset()

    def __iter__(self) -> Iterator[Object]:
        return iter(self._objects.values())

    def reset(self) -> None:
        """Set every value to its default."""
        self._values = {key: each.default for key, each in self._variables.items()}

    def variable(self, index: int, sub_index: int) -> Variable:
        """Return the variable at an address.

        Raises
        ------
        SdoAbortError
            NO_OBJECT or NO_SUB_INDEX.
        """
        if index not in self._objects:
            raise SdoAbortError(AbortCode.NO_OBJECT)
        found = self._variables.get((index, sub_index))
        if found is None:
            raise SdoAbortError(AbortCode.NO_SUB_INDEX)
        return found

    def number(self, index: int, sub_index: int = 0) -> int:
        """Return the present value of an integer variable (KeyError if there is none)."""
        value = self._values[index, sub_index]
        return value if isinstance(value, int) else 0

    def set(self, index: int, sub_index: int, value: Value) -> None:
        """Set a value from within the firmware, without checks of access or range."""
        self._values[index, sub_index] = value

    def on_read(self, index: int, sub_index: int, reader: Callable[[], Value]) -> None:
        """Let `reader` produce the value that a client reads; it may raise `SdoAbortError`."""
        self._readers[index, sub_index] = reader

    def on_write(self, index: int, sub_index: int, writer: Callable[[int], None]) -> None:
        """Call `writer` with a value in range before it is stored; it may raise `SdoAbortError`."""
        self._writers[index, sub_index] = writer

    def upload(self, index: int, sub_index: int) -> bytes:
        """Read for an SDO client.

        Raises
        ------
        SdoAbortError
            NO_OBJECT, NO_SUB_INDEX, WRITE_ONLY, or the reader's refusal.
        """
        found = self.variable(index, sub_index)
        if not found.access.readable:
            raise SdoAbortError(AbortCode.WRITE_ONLY)
        reader = self._readers.get(found.key)
        return found.to_bytes(self._values[found.key] if reader is None else reader())

    def writable(self, index: int, sub_index: int) -> Variable:
        """Return a variable that a client may write.

        Raises
        ------
        SdoAbortError
            NO_OBJECT, NO_SUB_INDEX or READ_ONLY.
        """
        found = self.variable(index, sub_index)
        if not found.access.writable:
            raise SdoAbortError(AbortCode.READ_ONLY)
        return found

    def download(self, index: int, sub_index: int, data: bytes) -> None:
        """Write for an SDO client.

        Raises
        ------
        SdoAbortError
            As for `writable`; DEVICE_STATE while the dictionary is locked, LENGTH, RANGE, or the
            writer's refusal; then nothing has changed.
        """
        found = self.writable(index, sub_index)
        if self.is_locked():
            raise SdoAbortError(AbortCode.DEVICE_STATE)
        self.force(*found.key, found.from_bytes(data))

    def force(self, index: int, sub_index: int, value: Value) -> None:
        """Write as a client, but without checks of access, range or lock."""
        writer = self._writers.get((index, sub_index))
        if writer is not None and isinstance(value, int):
            writer(value)
        self._values[index, sub_index] = value

    def stored(self) -> dict[Key, int]:
        """Return the present values of all variables that "save" stores."""
        return {key: self.number(*key) for key, each in self._variables.items() if each.stored}

    def restore(self, values: dict[Key, int]) -> None:
        """Replace present values by stored ones.

        Raises
        ------
        ValueError
            If one is not a stored variable of this node, or out of its range; nothing has changed.
        """
        for key, value in values.items():
            found = self._variables.get(key)
            if found is None or not found.stored:
                raise ValueError(f"{key[0]:04X}:{key[1]:02X} is no stored parameter")
            try:
                found.from_bytes(value.to_bytes(found.size or 0, "little"))
            except (SdoAbortError, OverflowError):
                raise ValueError(f"{key[0]:04X}:{key[1]:02X} = {value} is out of range") from None
        self._values.update(values)
