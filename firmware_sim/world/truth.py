"""Ground truth, lidar scans and pictures on local streams, for scoring and for estimators.

Ground truth must never reach the controller, and a lidar's scans (360 ranges at 10 Hz) and a
camera's pictures do not fit a classic CAN bus, so none travels on it. All are published on ZeroMQ
PUB sockets on `ipc://` addresses, one MessagePack message a sample (`msgspec`, arrays as below):
the same transport that the robot's own processes use among each other (`publisher.py`).
"""

from __future__ import annotations

import msgspec


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
    body
        State of the robot's body, by its number in the robot's file; 0: there is one only.
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
    body: int = 0


class Scan(msgspec.Struct, frozen=True, gc=False, tag="LidarScan"):
    """One scan of the planar lidar.

    Attributes
    ----------
    stamp_ns
        Time of the scan, of the beam measured last.
    x_m, y_m
        Mount of the lidar in base.
    first_rad, step_rad
        Beam i looks at first + i * step from forward in base, counter-clockwise.
    max_range_m
        Maximum range.
    ranges
        Ranges [m], float32 little-endian, one a beam; inf: nothing came back.
    name
        Name of the lidar.
    sweep_s
        Time from the first beam to the last [s]; negative: the last was measured first.
    """

    stamp_ns: int
    x_m: float
    y_m: float
    first_rad: float
    step_rad: float
    max_range_m: float
    ranges: bytes
    name: str = ""
    sweep_s: float = 0.0


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
