"""Local streams of ground truth, scans and pictures.

A subscriber that is slow or absent loses samples and never delays the simulator. The sockets lie in
a directory that only the user may enter.
"""

from __future__ import annotations

import socket
from pathlib import Path
from types import TracebackType

import msgspec
import zmq

from firmware_sim.errors import SimulationError
from firmware_sim.world.truth import Picture, Scan, Truth

IPC = "ipc://"
_QUEUE_LIMIT = 16


class Publisher:
    """A PUB socket on an `ipc://` address.

    Parameters
    ----------
    address
        `ipc://PATH`. The directory of PATH is made, private to the user, where it is missing.
    queue_limit
        Messages kept for a slow subscriber.

    Raises
    ------
    SimulationError
        If the address is invalid or taken, its directory is open to others, or it cannot be bound.
    """

    def __init__(self, address: str, queue_limit: int = _QUEUE_LIMIT) -> None:
        self.address = address
        self._path = _private_path(address)
        self._encoder = msgspec.msgpack.Encoder()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self._socket.setsockopt(zmq.SNDHWM, queue_limit)
        self._socket.setsockopt(zmq.LINGER, 0)
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self._context.destroy(linger=0)
            raise SimulationError(f"{address}: cannot be bound: {error}") from error

    def publish(self, sample: Truth | Scan | Picture) -> None:
        """Send one sample to the subscribers; never waits."""
        self._socket.send(self._encoder.encode(sample), zmq.DONTWAIT)

    def close(self) -> None:
        """Release the socket and remove its file."""
        self._socket.close(linger=0)
        self._context.term()
        self._path.unlink(missing_ok=True)

    def __enter__(self) -> Publisher:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def _private_path(address: str) -> Path:
    """Return the path of an address whose directory only the user may enter."""
    path = Path(address.removeprefix(IPC))
    if not address.startswith(IPC) or not path.is_absolute():
        raise SimulationError(f"{address}: not an address; allowed is ipc:///ABSOLUTE/PATH")
    directory = path.parent
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        mode = directory.stat().st_mode
    except OSError as error:
        raise SimulationError(f"{address}: {error}") from error
    if mode & 0o077:
        raise SimulationError(
            f"{address}: others may enter {directory}; allowed is a directory of mode 0700"
        )
    _check_free(path, address)
    return path


def _check_free(path: Path, address: str) -> None:
    """Raise SimulationError if binding would remove a file, or replace a publisher."""
    if path.is_socket():
        with socket.socket(socket.AF_UNIX) as probe:
            if probe.connect_ex(str(path)) == 0:
                raise SimulationError(f"{address}: another process publishes there")
    elif path.exists():
        raise SimulationError(f"{address}: there is something that is no socket")
