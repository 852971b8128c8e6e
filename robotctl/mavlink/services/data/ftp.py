"""Files over MAVLink: logs, own files of ground stations, and the parameters as files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Final

from pymavlink.dialects.v20 import common

from robotctl.dialect import additions
from robotctl.mavlink.catalogue import Stream
from robotctl.mavlink.context import Context
from robotctl.mavlink.event_kinds import event_metadata
from robotctl.mavlink.frames import boot_ms
from robotctl.mavlink.ftp.files import Content, Entry, Mounted, NoFiles, OpenFile
from robotctl.mavlink.ftp.payload import FtpError, FtpRefused
from robotctl.mavlink.ftp.server import FtpServer, Sender
from robotctl.mavlink.parameters.metadata import (
    EVENTS,
    PARAMETERS,
    file_crc,
    general_metadata,
    parameter_metadata,
)
from robotctl.mavlink.parameters.packed import packed
from robotctl.mavlink.service import Microservice
from robotctl.messages.mavlink_port import Message, Peer, source

PARAM: Final = "@PARAM"
META: Final = "@META"
PARAMETER_FILE: Final = "parameter.json"
EVENT_FILE: Final = "events.json"
GENERAL: Final = "general.json"


class Made(NoFiles):
    """A folder of files that are made when they are read.

    Parameters
    ----------
    makers
        Return the content, by name; those with a `?` are read, too, but not listed.
    """

    def __init__(self, makers: Mapping[str, Callable[[], bytes]]) -> None:
        self._makers = makers

    def list(self, path: str) -> Sequence[Entry]:
        """Return the names, sorted."""
        super().list(path)
        makers = self._makers.items()
        return sorted(Entry(name, len(make())) for name, make in makers if "?" not in name)

    def open(self, path: str) -> OpenFile:
        """Open a file as it is now."""
        if path not in self._makers:
            raise FtpRefused(FtpError.FILE_NOT_FOUND)
        return Content(self._makers[path]())


class Ftp(Microservice):
    """Serves files. https://mavlink.io/en/services/ftp.html."""

    handles = frozenset({common.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL})
    capabilities: ClassVar[int] = common.MAV_PROTOCOL_CAPABILITY_FTP

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        parameters = context.parameters
        makers = {
            "param.pck": lambda: packed(parameters, with_defaults=False),
            "param.pck?withdefaults=1": lambda: packed(parameters, with_defaults=True),
        }
        self._metadata: dict[str, Callable[[], bytes]] = {
            GENERAL: self._general,
            EVENT_FILE: lambda: event_metadata(context.config.component_id),
            PARAMETER_FILE: lambda: parameter_metadata(parameters),
        }
        mounts = {PARAM: Made(makers), META: Made(self._metadata), **context.folders}
        files = Mounted(mounts.pop("", NoFiles()), mounts)
        self._server = FtpServer(files, self._send)

    def streams(self) -> tuple[Stream, ...]:
        """Return COMPONENT_METADATA, which tells of the files about parameters, on request."""
        return (Stream(additions.MAVLINK_MSG_ID_COMPONENT_METADATA, self._where, None),)

    def _general(self) -> bytes:
        files = {PARAMETERS: PARAMETER_FILE, EVENTS: EVENT_FILE}
        return general_metadata(
            {kind: (_uri(name), self._metadata[name]()) for kind, name in files.items()}
        )

    def _where(self, now_ns: int) -> list[Message]:
        crc, uri = file_crc(self._metadata[GENERAL]()), _uri(GENERAL).encode()
        return [additions.MAVLink_component_metadata_message(boot_ms(now_ns), crc, uri)]

    def on_message(self, message: Message, peer: Peer, now_ns: int) -> None:
        """Take a request."""
        self._server.receive(bytes(message.payload), Sender(*source(message), peer), now_ns)

    def step(self, now_ns: int) -> None:
        """Send the next parts of what is read."""
        self._server.step(now_ns)

    def _send(self, payload: bytes, sender: Sender) -> None:
        reply = common.MAVLink_file_transfer_protocol_message(
            0, sender.system, sender.component, payload
        )
        self._context.links.reply(reply, sender.peer)


def _uri(name: str) -> str:
    return f"mftp:///{META}/{name}"
