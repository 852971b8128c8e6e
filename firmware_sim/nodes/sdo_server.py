"""SDO server: expedited and segmented transfers of one channel (CiA 301, 7.2.4.3).

Block transfers are refused with abort 0x05040001, as CiA 301 allows.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from firmware_sim.nodes.object_dictionary import ObjectDictionary
from firmware_sim.nodes.variables import AbortCode, SdoAbortError, Variable

_HEADER = struct.Struct("<BHB4s")
_ABORT = struct.Struct("<BHBI")
_SIZE = struct.Struct("<I")

_DOWNLOAD_SEGMENT = 0
_INITIATE_DOWNLOAD = 1
_INITIATE_UPLOAD = 2
_UPLOAD_SEGMENT = 3
_ABORT_TRANSFER = 4

_EXPEDITED = 0x02
_SIZE_GIVEN = 0x01
_TOGGLE = 0x10
_LAST_SEGMENT = 0x01
_SEGMENT_BYTES = 7


@dataclass(slots=True)
class _Upload:
    """A segmented upload in progress: the data still to send."""

    index: int
    sub_index: int
    rest: bytes
    toggle: int = 0


@dataclass(slots=True)
class _Download:
    """A segmented download in progress: the data received."""

    variable: Variable
    data: bytearray = field(default_factory=bytearray)
    toggle: int = 0


class SdoServer:
    """One SDO channel to an object dictionary.

    Parameters
    ----------
    dictionary
        The dictionary that clients access.
    """

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._transfer: _Upload | _Download | None = None

    def reset(self) -> None:
        """Drop a transfer in progress."""
        self._transfer = None

    def respond(self, request: bytes) -> bytes | None:
        """Return the response to one request frame; None if there is none to give."""
        if len(request) != 8:
            return None
        command, index, sub_index, data = _HEADER.unpack(request)
        specifier = command >> 5
        if specifier == _ABORT_TRANSFER:
            self._transfer = None
            return None
        transfer = self._transfer
        if specifier in {_DOWNLOAD_SEGMENT, _UPLOAD_SEGMENT} and transfer is not None:
            index, sub_index = _address(transfer)
        try:
            if specifier == _INITIATE_UPLOAD:
                return self._initiate_upload(index, sub_index)
            if specifier == _INITIATE_DOWNLOAD:
                return self._initiate_download(command, index, sub_index, data)
            if specifier == _UPLOAD_SEGMENT and isinstance(transfer, _Upload):
                return self._upload_segment(transfer, command)
            if specifier == _DOWNLOAD_SEGMENT and isinstance(transfer, _Download):
                return self._download_segment(transfer, command, request[1:])
            raise SdoAbortError(AbortCode.COMMAND)
        except SdoAbortError as abort:
            self._transfer = None
            return _ABORT.pack(_ABORT_TRANSFER << 5, index, sub_index, abort.code)

    def _initiate_upload(self, index: int, sub_index: int) -> bytes:
        data = self._dictionary.upload(index, sub_index)
        command = _INITIATE_UPLOAD << 5 | _SIZE_GIVEN
        if 1 <= len(data) <= 4:
            self._transfer = None
            unused = 4 - len(data)
            return _HEADER.pack(command | _EXPEDITED | unused << 2, index, sub_index, data)
        self._transfer = _Upload(index, sub_index, data)
        return _HEADER.pack(command, index, sub_index, _SIZE.pack(len(data)))

    def _upload_segment(self, transfer: _Upload, command: int) -> bytes:
        if command & _TOGGLE != transfer.toggle:
            raise SdoAbortError(AbortCode.TOGGLE)
        segment, transfer.rest = transfer.rest[:_SEGMENT_BYTES], transfer.rest[_SEGMENT_BYTES:]
        head = transfer.toggle | (_SEGMENT_BYTES - len(segment)) << 1
        transfer.toggle ^= _TOGGLE
        if not transfer.rest:
            head |= _LAST_SEGMENT
            self._transfer = None
        return bytes((head,)) + segment.ljust(_SEGMENT_BYTES, b"\0")

    def _initiate_download(self, command: int, index: int, sub_index: int, data: bytes) -> bytes:
        self._transfer = None
        variable = self._dictionary.writable(index, sub_index)
        if command & _EXPEDITED:
            size = 4 - (command >> 2 & 0x3) if command & _SIZE_GIVEN else variable.size or 4
            self._dictionary.download(index, sub_index, data[:size])
        else:
            if command & _SIZE_GIVEN and variable.size not in {None, _SIZE.unpack(data)[0]}:
                raise SdoAbortError(AbortCode.LENGTH)
            self._transfer = _Download(variable)
        return _HEADER.pack(3 << 5, index, sub_index, bytes(4))

    def _download_segment(self, transfer: _Download, command: int, data: bytes) -> bytes:
        if command & _TOGGLE != transfer.toggle:
            raise SdoAbortError(AbortCode.TOGGLE)
        transfer.data += data[: _SEGMENT_BYTES - (command >> 1 & 0x7)]
        variable = transfer.variable
        if variable.size is not None and len(transfer.data) > variable.size:
            raise SdoAbortError(AbortCode.LENGTH)
        if command & _LAST_SEGMENT:
            self._transfer = None
            self._dictionary.download(*variable.key, bytes(transfer.data))
        response = _DOWNLOAD_RESPONSE | transfer.toggle
        transfer.toggle ^= _TOGGLE
        return bytes((response,)) + bytes(_SEGMENT_BYTES)


_DOWNLOAD_RESPONSE = 1 << 5


def _address(transfer: _Upload | _Download) -> tuple[int, int]:
    if isinstance(transfer, _Upload):
        return transfer.index, transfer.sub_index
    return transfer.variable.key
