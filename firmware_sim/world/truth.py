"""Ground truth, lidar scans and pictures on local streams, for scoring and for estimators.

Ground truth must never reach the controller, and a lidar's scans (360 ranges at 10 Hz) and a
camera's pictures do not fit a classic CAN bus, so none travels on it. All are published on ZeroMQ
PUB sockets on `ipc://` addresses, one MessagePack message a sample (`msgspec`, arrays as below):
the same transport that the robot's own processes use among each other. A subscriber that is slow or
absent loses samples and never delays the simulator. The sockets lie in a directory that only the
user may enter.
"""

from __future__ import annotations

import socket
from pathlib import Path
from types import TracebackType

import msgspec
import zmq

from firmware_sim.errors import SimulationError

IPC = "ipc://"
_QUEUE_LIMIT = 16


class Truth(msgspec.Struct, frozen=True, gc=False):
    """The true state. Pose of `base` in `world`; times on CLOCK_MONOTONIC.

    Attributes
    ----------
    stamp_ns
        Time of the sample.
    x_m, y_m, theta_rad
        Pose, heading in (-pi, pi].
    v_m_s, vy_m_s, omega_rad_s
        Body velocity of base: forwards, to the left, counter-clockwise.
    distance_m
        Length of the path since the start.
    collisions
        Collisions since the start, with people only those that the robot caused.
    ran_into
        Contacts that people caused.
    people
        Positions of the people: x, y [m].
    charge
        Charge of the battery, [0, 1].
    bus_frames, bus_errors
        Frames and errors on the simulated bus since the start.
    bus_load
        Bus load in the last second, [0, 1].
    late
        Number of times that the simulator lagged so far that it dropped time; 0 in lockstep.
    late_max_ns
        Maximum lateness of the simulator, whether it dropped time or not [ns].
    power_off_ns
        Time at which the wheels last lost power, to 5 ms; time 0 of the simulation before that.
    unsafe_motions, unsafe_reason
        Unauthorised motions since the start, and the reason of the last: see
        `firmware_sim.faults.monitor`.
    """

    stamp_ns: int
    x_m: float
    y_m: float
    theta_rad: float
    v_m_s: float
    omega_rad_s: float
    distance_m: float
    collisions: int
    charge: float
    bus_frames: int
    bus_load: float
    bus_errors: int
    late: int = 0
    late_max_ns: int = 0
    power_off_ns: int = 0
    unsafe_motions: int = 0
    unsafe_reason: str = ""
    ran_into: int = 0
    people: tuple[tuple[float, float], ...] = ()
    vy_m_s: float = 0.0


class Scan(msgspec.Struct, frozen=True, gc=False, tag="LidarScan"):
    """One scan of the planar lidar.

    Attributes
    ----------
    stamp_ns
        Time of the scan, all beams at once.
    x_m, y_m
        Mount of the lidar in base.
    first_rad, step_rad
        Beam i looks at first + i * step from forward in base, counter-clockwise.
    max_range_m
        Maximum range.
    ranges
        Ranges [m], float32 little-endian, one a beam; inf: nothing came back.
    """

    stamp_ns: int
    x_m: float
    y_m: float
    first_rad: float
    step_rad: float
    max_range_m: float
    ranges: bytes


class Picture(msgspec.Struct, frozen=True, gc=False, tag="CameraFrame"):
    """One picture of the camera.

    Attributes
    ----------
    stamp_ns
        Time of the exposure, all rows at once.
    sequence
        Number of the exposure; dropped pictures leave gaps.
    width, height
        Size [px].
    encoding
        `bgr8`: a byte each of blue, green and red for a pixel, row by row from the upper left.
    pixels
        width * height * 3 bytes.
    """

    stamp_ns: int
    sequence: int
    width: int
    height: int
    encoding: str
    pixels: bytes


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
