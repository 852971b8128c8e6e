"""Messages to and from the estimators: observations, the robot's pose, drawings for people."""

from __future__ import annotations

from typing import TypeAlias

import msgspec

from robotctl.model.geometry.localisation import LocalisationStatus
from robotctl.model.geometry.se2 import SE2


class LidarScan(msgspec.Struct, frozen=True, tag=True):
    """One scan of a planar lidar, as its driver publishes it on the local socket `lidar`.

    Beam i has the direction `first_rad + i * step_rad` from forward of `base`, to the left; the
    sensor is at `x_m`, `y_m` of `base`. `ranges` are float32, little-endian [m]: inf without an
    echo within `max_range_m`. A robot with several lidars has a `name` for each.

    A lidar that sweeps takes `sweep_s` from its first beam to its last [s], negative if it measures
    the last one first; `stamp_ns` is the time of the one it measures last. Who takes the scan
    takes the robot's motion out. 0: all beams are of one instant.
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


class SeenObstacle(msgspec.Struct, frozen=True):
    """An object on the floor, as seen by the camera, in `base`.

    Middle of its foot on the robot's side (m), the upper triangle of that point's covariance
    (m^2), and its width across the line of sight (m).
    """

    x_m: float
    y_m: float
    covariance: tuple[float, ...]
    width_m: float


class SeenMarker(msgspec.Struct, frozen=True):
    """An upright marker, as seen by the camera, in `base`.

    Its number, its middle (m), and the heading of a viewer square to it (rad, left of forward).
    """

    number: int
    x_m: float
    y_m: float
    theta_rad: float


class ImageFeatures(msgspec.Struct, frozen=True):
    """Corners of a picture, for recognising places.

    `points` are u and v as shares of the picture's diagonal, float32, `descriptors` 32 bytes each;
    `aspect` is the ratio of the picture's shorter to its longer side.
    """

    points: bytes
    descriptors: bytes
    aspect: float


class CameraView(msgspec.Struct, frozen=True, tag=True):
    """Result of the camera process for one picture.

    Beam i looks from `x_m`, `y_m` of `base` at `angles_rad[i]` from forward, to the left. Ranges
    (m): inf: floor up to `max_range_m`, nan: not judged; `sigmas_m` are their standard deviations.
    Floor nearer than `nearest_m` is not in the picture. `trouble` is the reason for distrust of
    the picture, empty for none. `features` are sent a few times a second if places are recognised
    by them.
    """

    stamp_ns: int
    x_m: float
    y_m: float
    max_range_m: float
    angles_rad: tuple[float, ...]
    ranges_m: tuple[float, ...]
    sigmas_m: tuple[float, ...]
    nearest_m: tuple[float, ...]
    obstacles: tuple[SeenObstacle, ...] = ()
    trouble: str = ""
    step_us: float = 0.0
    markers: tuple[SeenMarker, ...] = ()
    features: ImageFeatures | None = None


SensorMessage: TypeAlias = LidarScan | CameraView
"""Messages to the navigation process from sensors off the CAN bus."""


class ClosedLoop(msgspec.Struct, frozen=True):
    """A closed loop: the pose of `base` at a time, in its pose at an earlier time.

    Times in ns; `x_m`, `y_m`, `theta_rad` are the later pose in the earlier one (m, rad).
    """

    stamp_ns: int
    earlier_ns: int
    x_m: float
    y_m: float
    theta_rad: float


class LocalisationState(msgspec.Struct, frozen=True, tag=True):
    """State of the localiser, published after each step of the navigation process.

    `x_m`, `y_m`, `theta_rad` are `T_world_odom`, the pose of `odom` in `world` (m, rad), valid for
    the odometry of `odom_epoch_ns`; `WorldPose` decides whether they count. `epoch_ns` is the time
    of the last jump of `T_world_odom` (ns), apart from corrections of odometry drift. `covariance`
    is the upper triangle of the covariance of (x, y, theta) of `base` in `world`, row by row
    [m, m, rad]. `nis` is the normalised innovation squared of the EKF's last
    update (nan without one) and `nis_dof` its degrees of freedom; `particles` is 0 for the EKF.
    `loops` are those that SLAM closed in this step; `verdict` says how good its map is, and why it
    is no better. `paused`: the map that the robot makes stays as it is. `tracked`: a localised
    robot's place has become less sure, as along a corridor, but nothing speaks against it.
    """

    stamp_ns: int
    method: str
    status: LocalisationStatus
    x_m: float
    y_m: float
    theta_rad: float
    covariance: tuple[float, ...]
    particles: int = 0
    nis: float = float("nan")
    nis_dof: int = 0
    step_us: float = 0.0
    odom_epoch_ns: int = 0
    epoch_ns: int = 0
    loops: tuple[ClosedLoop, ...] = ()
    verdict: str = ""
    paused: bool = False
    tracked: bool = False

    @property
    def T_world_odom(self) -> SE2:
        """The pose of `odom` in `world`."""
        return SE2(self.x_m, self.y_m, self.theta_rad)


class ParticleCloud(msgspec.Struct, frozen=True, tag=True):
    """Some of the particles, for display: float32 x, y, theta in `world` of each [m, m, rad]."""

    stamp_ns: int
    poses: bytes


class LiveMap(msgspec.Struct, frozen=True, tag=True):
    """The growing map: int8 cells by rows from the lower edge, as `model.grid_map.GridMap`."""

    stamp_ns: int
    rows: int
    columns: int
    resolution_m: float
    x_m: float
    y_m: float
    cells: bytes
    theta_rad: float = 0.0


class SlamGraph(msgspec.Struct, frozen=True, tag=True):
    """The graph of SLAM, for display: keyframes and links.

    `poses` holds x, y and heading of each in `world` as little-endian float32 [m, m, rad]; `links`
    pairs of their numbers as little-endian int32, `loops` those that closed a loop.
    """

    stamp_ns: int
    poses: bytes
    links: bytes
    loops: bytes


class PlanView(msgspec.Struct, frozen=True, tag=True):
    """Plan of the robot and its surroundings in `world`, for display.

    `path` holds the rest of the planned path and `arc` the predicted path of the present velocity:
    poses of `base`, x, y and heading as little-endian float32 [m, m, rad]; both are empty without a
    plan. `obstacles` holds x and y of seen obstacles that are on no map, `moving` moving obstacles:
    x, y, vx, vy and radius [m, m/s]. `costs` is the map around the robot: 100 where the body
    collides at any heading, 0 where it is free.
    """

    stamp_ns: int
    path: bytes
    arc: bytes
    obstacles: bytes
    moving: tuple[tuple[float, float, float, float, float], ...]
    costs: LiveMap


class GivenMap(msgspec.Struct, frozen=True, tag=True):
    """The map that the localiser was given, repeated for late subscribers.

    It has a type of its own because subscribers and logs tell it from the `LiveMap` that grows.
    """

    stamp_ns: int
    map: LiveMap
