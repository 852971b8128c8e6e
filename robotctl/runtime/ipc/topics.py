"""Messages between the processes of one robot: ZeroMQ over Unix sockets, msgpack by msgspec.

States are published (PUB/SUB): late subscribers miss the past, as they should for states. Requests
are pushed (PUSH/PULL) and never kept for an absent process: a request to move or to arm that waited
for a restart would be a surprise.
"""

from __future__ import annotations

import os
import select
import tempfile
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec
import zmq

from robotctl.errors import LinkError

T = TypeVar("T")

_QUEUE = 256
_PATH_BYTES = 107
"""Maximum length of the path of a Unix socket: `sun_path` of unix(7) without its end."""

_LONGEST = "navigation.requests"
_MEMORY = Path("/dev/shm")  # noqa: S108 - a private directory in it


def endpoint_path(instance: str) -> Path:
    """Return the folder of the sockets of a robot `instance`, whether or not it exists.

    Raises
    ------
    LinkError
        If the name cannot be that of a folder, the path is too long for a socket, or no folder
        accepts temporary files.
    """
    if "/" in instance or "\0" in instance or instance in ("", ".", ".."):
        raise LinkError(
            f"{instance!r}: the name of a robot must not be empty, . or .. nor have a /"
        )
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    try:
        base = Path(runtime or tempfile.gettempdir())
    except FileNotFoundError as error:
        raise LinkError(
            f"sockets of {instance}: no folder for temporary files can be written; set "
            "XDG_RUNTIME_DIR or TMPDIR to one that can"
        ) from error
    path = base / ("robotctl" if runtime else f"robotctl-{os.getuid()}") / instance
    excess = len(os.fsencode(path / _LONGEST)) - _PATH_BYTES
    if excess > 0:
        raise LinkError(
            f"{path}: {excess} bytes too long for the path of a socket; set "
            f"{'XDG_RUNTIME_DIR' if runtime else 'TMPDIR'} to a folder with a shorter path"
        )
    return path


def endpoint_directory(instance: str) -> Path:
    """Make and return the private directory of the sockets of one robot `instance`.

    Raises
    ------
    LinkError
        As for `endpoint_path`, and if the directory belongs to another user or is open to others.
    """
    path = endpoint_path(instance)
    _private(path.parent)
    return _private(path)


def ring_path(instance: str) -> Path:
    """Return the path of a robot's flight ring, in memory, in a private directory, made here.

    One ring belongs to one `endpoint_directory`, whose path is part of its name.

    Raises
    ------
    LinkError
        As for `endpoint_directory`.
    """
    endpoint_directory(instance)
    return _private(ring_folder()) / ring_name(instance)


def ring_folder() -> Path:
    """Return the folder of this user's flight rings, whether or not it exists.

    Raises
    ------
    LinkError
        If the folder belongs to another user or is open to others.
    """
    folder = _MEMORY / f"robotctl-{os.getuid()}"
    with suppress(FileNotFoundError):
        _refuse_others(folder)
    return folder


def ring_name(instance: str) -> str:
    """Return the name of a robot's flight ring in `ring_folder`.

    Raises
    ------
    LinkError
        As for `endpoint_path`.
    """
    return f"{instance}-{zlib.crc32(bytes(endpoint_path(instance))):08x}.ring"


def _private(directory: Path) -> Path:
    """Make a directory that only this user can enter."""
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
        _refuse_others(directory)
    except OSError as error:
        raise LinkError(f"{directory}: cannot be created: {error.strerror}") from error
    return directory


def _refuse_others(directory: Path) -> None:
    """Raise a `LinkError` for a directory open to others; an `OSError` for none."""
    status = directory.lstat()
    if status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise LinkError(f"{directory}: must belong to user {os.getuid()} and be closed to others")


class Endpoints:
    """Addresses of the sockets of one robot instance.

    Parameters
    ----------
    directory
        Folder of the sockets; see `endpoint_directory`.
    """

    def __init__(self, directory: Path) -> None:
        self.control_state = f"ipc://{directory}/control.state"
        self.control_requests = f"ipc://{directory}/control.requests"
        self.navigation_state = f"ipc://{directory}/navigation.state"
        self.navigation_requests = f"ipc://{directory}/navigation.requests"
        self.telemetry_notices = f"ipc://{directory}/telemetry.notices"
        self.telemetry_requests = f"ipc://{directory}/telemetry.requests"
        self.parameters = f"ipc://{directory}/parameters"
        """Address of the parameters, which telemetry owns; not in `published`, since not logged."""
        self.recorder_notices = f"ipc://{directory}/recorder.notices"
        self.recorder_requests = f"ipc://{directory}/recorder.requests"
        self.supervisor_notices = f"ipc://{directory}/supervisor.notices"
        """Address of the supervisor's notices; not in `published`, since already reported."""
        self.supervisor_requests = f"ipc://{directory}/supervisor.requests"
        self.truth = f"ipc://{directory}/truth"
        self.lidar = f"ipc://{directory}/lidar"
        self.camera = f"ipc://{directory}/camera"
        self.camera_frames = f"ipc://{directory}/camera.frames"
        self.web_notices = f"ipc://{directory}/web.notices"
        self.foxglove_notices = f"ipc://{directory}/foxglove.notices"
        self.web_links = directory / "web.links"
        """File with the addresses of the web page, tokens included."""

    @property
    def published(self) -> tuple[str, ...]:
        """Sources of the states, notices, scans and views of all processes."""
        return (
            self.control_state,
            self.navigation_state,
            self.telemetry_notices,
            self.recorder_notices,
            self.web_notices,
            self.foxglove_notices,
            self.lidar,
            self.camera,
        )


class Publisher:
    """Publishes messages, or ready-made bytes, to subscribers.

    Parameters
    ----------
    context, address
        ZeroMQ context, and address to publish on.
    queue
        Maximum messages kept for a slow subscriber; newer ones are dropped.
    """

    def __init__(self, context: zmq.Context[Any], address: str, queue: int = _QUEUE) -> None:
        self._socket = _socket(context, zmq.PUB, queue)
        _bind(self._socket, address)
        self._encoder = msgspec.msgpack.Encoder()

    def send(self, message: msgspec.Struct) -> None:
        """Publish one message without waiting."""
        self._socket.send(self._encoder.encode(message), zmq.NOBLOCK)

    def greet(self, message: msgspec.Struct | None) -> None:
        """Send `message` to each new subscriber from now on, instead of the previous one.

        None: no greeting.

        Messages of a process at its start, before anyone listens, arrive this way. The greeting is
        sent with the next `send` or `attend` after a subscriber connects.
        """
        words = b"" if message is None else self._encoder.encode(message)
        # Documented for XPUB; it works for PUB, which libzmq derives from it.
        self._socket.setsockopt(zmq.XPUB_WELCOME_MSG, words)

    def attend(self) -> None:
        """Greet new subscribers, for a process that seldom sends."""
        # The query lets the socket process pending subscriptions.
        self._socket.getsockopt(zmq.EVENTS)

    def send_bytes(self, data: bytes) -> None:
        """Publish bytes without waiting."""
        self._socket.send(data, zmq.NOBLOCK)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class _Receiver(Generic[T]):
    """Reads messages of the types in `kind`; others are dropped and counted."""

    def __init__(self, socket: zmq.Socket[bytes], kind: Any) -> None:
        self.rejected = 0
        self._socket = socket
        self._decoder = msgspec.msgpack.Decoder(kind)
        self._signal = select.poll()
        self._signal.register(self.fileno(), select.POLLIN)

    def receive(self) -> list[T]:
        """Return all waiting messages, oldest first, without waiting.

        Polling the descriptor first costs a fifth of polling the socket, which matters in a control
        tick. It signals changes only, not waiting messages, so always read everything.
        """
        messages: list[T] = []
        if not self._signal.poll(0):
            return messages
        while _readable(self._socket):
            try:
                messages.append(self._decoder.decode(self._socket.recv(zmq.NOBLOCK)))
            except (msgspec.DecodeError, UnicodeDecodeError):
                self.rejected += 1
            except zmq.Again:
                break
        return messages

    def fileno(self) -> int:
        """Return a descriptor that wakes a poll; read until `receive` is empty after it did."""
        return int(self._socket.getsockopt(zmq.FD))

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class Subscriber(_Receiver[T]):
    """Listens to publishers, which may start later or restart."""

    def __init__(self, context: zmq.Context[Any], addresses: tuple[str, ...], kind: Any) -> None:
        socket = _socket(context, zmq.SUB)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        for address in addresses:
            socket.connect(address)
        super().__init__(socket, kind)


class RawSubscriber:
    """Listens to publishers, and returns their messages as raw bytes."""

    def __init__(self, context: zmq.Context[Any], addresses: tuple[str, ...]) -> None:
        self._socket = _socket(context, zmq.SUB)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        for address in addresses:
            self._socket.connect(address)

    def receive(self) -> list[bytes]:
        """Return all waiting messages, oldest first, without waiting."""
        messages = []
        while _readable(self._socket):
            messages.append(self._socket.recv(zmq.NOBLOCK))
        return messages


class RequestReceiver(_Receiver[T]):
    """Takes requests from any process of the same user."""

    def __init__(self, context: zmq.Context[Any], address: str, kind: Any) -> None:
        socket = _socket(context, zmq.PULL)
        _bind(socket, address)
        super().__init__(socket, kind)


class RequestSender:
    """Sends requests to one process; they are dropped if it is absent."""

    def __init__(self, context: zmq.Context[Any], address: str) -> None:
        self._socket = _socket(context, zmq.PUSH)
        # Otherwise ZeroMQ queues requests for an absent process, and an old request to move would
        # wait for its restart.
        self._socket.setsockopt(zmq.IMMEDIATE, 1)
        self._socket.connect(address)
        self._encoder = msgspec.msgpack.Encoder()

    def send(self, request: msgspec.Struct) -> bool:
        """Send one request without waiting; return whether a process took it."""
        try:
            self._socket.send(self._encoder.encode(request), zmq.NOBLOCK)
        except zmq.Again:
            return False
        return True

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _readable(socket: zmq.Socket[bytes]) -> bool:
    """Return whether a message waits; cheaper than the exception of an empty `recv`."""
    return bool(int(socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN)


def _socket(context: zmq.Context[Any], kind: int, queue: int = _QUEUE) -> zmq.Socket[bytes]:
    """Make a socket with bounded queues that does not delay the end of its process."""
    socket: zmq.Socket[bytes] = context.socket(kind)
    # Unsent messages must not delay the end of the process.
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.SNDHWM, queue)
    socket.setsockopt(zmq.RCVHWM, queue)
    return socket


def _bind(socket: zmq.Socket[bytes], address: str) -> None:
    """Bind; errors name the address."""
    try:
        socket.bind(address)
    except zmq.ZMQError as error:
        socket.close()
        raise LinkError(f"{address}: cannot be bound: {error}") from error
