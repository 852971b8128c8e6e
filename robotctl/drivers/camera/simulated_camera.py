"""Pictures on a local socket, from firmware_sim's camera, the counterpart of a real one.

The camera process publishes a real camera's there too, so that others can look on.
"""

from __future__ import annotations

import msgspec
import numpy as np
import zmq

from robotctl.errors import LinkError
from robotctl.messages.camera_port import CameraFrame

ENCODING = "bgr8"


class _Picture(msgspec.Struct, frozen=True, tag="CameraFrame"):
    """A picture on the wire: see `firmware_sim/world/truth.py`."""

    stamp_ns: int
    sequence: int
    width: int
    height: int
    encoding: str
    pixels: memoryview


def picture_message(frame: CameraFrame) -> bytes:
    """Return a picture in the format of the socket."""
    height, width = frame.image.shape[:2]
    pixels = frame.image.data.cast("B")
    return msgspec.msgpack.encode(
        _Picture(frame.stamp_ns, frame.sequence, width, height, ENCODING, pixels)
    )


class SimulatedCamera:
    """Receives from a simulated camera, which may start later or restart.

    Parameters
    ----------
    address
        `ipc://PATH`, as firmware_sim was given with `--camera`.

    Attributes
    ----------
    rejected
        Messages that were no pictures.

    Raises
    ------
    LinkError
        If that is no address.
    """

    def __init__(self, address: str) -> None:
        self.rejected = 0
        self._decoder = msgspec.msgpack.Decoder(_Picture)
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        # Newest only: set before the connection, as zmq_setsockopt(3) requires.
        self._socket.setsockopt(zmq.CONFLATE, 1)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SUBSCRIBE, b"")
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise LinkError(
                f"camera: {address}: {error}; allowed is the ipc:///PATH of firmware_sim --camera"
            ) from error

    def read(self) -> CameraFrame | None:
        """Return the newest picture not yet read; None if there is none."""
        try:
            data = self._socket.recv(zmq.NOBLOCK)
        except zmq.Again:
            return None
        try:
            picture = self._decoder.decode(data)
        except msgspec.DecodeError:
            self.rejected += 1
            return None
        if not _is_whole(picture):
            self.rejected += 1
            return None
        size = (picture.height, picture.width, 3)
        image = np.frombuffer(picture.pixels, dtype=np.uint8).reshape(size)
        return CameraFrame(picture.stamp_ns, picture.sequence, image)

    def close(self) -> None:
        """Stop listening."""
        self._context.destroy(linger=0)


def _is_whole(picture: _Picture) -> bool:
    """Return whether a message has as many pixels as it claims."""
    return (
        picture.encoding == ENCODING
        and picture.width > 0
        and picture.height > 0
        and len(picture.pixels) == 3 * picture.width * picture.height
    )
