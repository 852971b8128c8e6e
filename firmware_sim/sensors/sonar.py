"""The ring of ultrasonic sensors: echoes and their errors.

The first echo counts. It comes from the nearest surface in the cone that reflects back: one hit at
no more than the maximum incidence, or a concave corner. A surface hit at a flatter angle hides what
is behind it and returns nothing. Sensors of a group fire together; one may receive another's
sound.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.config.config import RobotConfig
from firmware_sim.config.parameters import SonarParameters
from firmware_sim.noise import noise_state, normal, uniform
from firmware_sim.sensors.rays import blocked, cast_fan, fan_angles
from firmware_sim.world.near import Near
from firmware_sim.world.world import World
from native_kernels.compiled import borrows, compiled

GROUP = 4
"""Number of sonars that fire together, those of one CAN frame."""
PER_M = 1000.0
"""Steps of a reported range per metre."""

SENSOR = np.dtype(
    [
        (name, np.float64)
        for name in (
            "half_beam",  # rad
            "cos_incidence",
            "min_range",
            "max_range",
            "sigma",
            "sigma_per_m",
            "outlier",
            "dropout",
            "crosstalk",
        )
    ]
)


def sensor_record(parameters: SonarParameters) -> np.ndarray:
    """Record of the sensors' constants, (1,)."""
    p = parameters
    record = np.zeros(1, SENSOR)
    record[0] = (
        math.radians(p.beam_deg) / 2.0,
        math.cos(math.radians(p.max_incidence_deg)),
        p.min_range_m,
        p.max_range_m,
        p.sigma_m,
        p.sigma_per_m,
        p.outlier_probability,
        p.dropout_probability,
        p.crosstalk_probability,
    )
    return record


class SonarRing:
    """All sonars of a robot.

    Parameters
    ----------
    config
        The robot: mounts and parameters.
    world
        The room.
    rng
        Generator of noise, outliers, drop-outs and cross-talk.
    """

    def __init__(self, config: RobotConfig, world: World, rng: np.random.Generator) -> None:
        p = config.simulation.sonar
        mounts = [(m.x_m, m.y_m, m.heading_rad) for m in config.sonar]
        self._mounts = np.array(mounts, dtype=np.float64).reshape(-1, 3)
        # The mirror of another's sound may be farther by half of the distance between both sonars.
        offset_m = max(np.hypot(*self._mounts[:, :2].T), default=0.0)
        reach_m = p.max_range_m + 2.0 * offset_m
        self.walls = Near(world.segments, reach_m)
        self._corners = Near(world.corners if p.corner_echo else world.corners[:0], reach_m)
        self._sensor = sensor_record(p)
        self._angles = fan_angles(p.rays, math.radians(p.beam_deg))
        self._ranges = np.empty(p.rays)
        self._hits = np.empty(p.rays, dtype=np.int32)
        self._poses = np.empty((GROUP, 3))
        self._echoes = np.empty(GROUP)
        self._noise = noise_state(rng)

    @property
    def groups(self) -> int:
        """Number of groups that fire in turn."""
        return -(-len(self._mounts) // GROUP)

    def warm(self) -> None:
        """Compile, or load from the cache, the functions of `fire`; draws no noise."""
        noise = self._noise.copy()
        self.fire(0, 0.0, 0.0, 0.0)
        self._noise[:] = noise

    def fire(
        self, group: int, x_m: float, y_m: float, theta_rad: float
    ) -> tuple[float, float, float, float]:
        """Fire the sonars 4·group to 4·group + 3 from a pose of base in world.

        Returns
        -------
        tuple
            Ranges [m], in whole millimetres; inf without an echo, nan if there is no sensor.
        """
        fire_group(
            self._mounts[GROUP * group : GROUP * (group + 1)],
            x_m,
            y_m,
            theta_rad,
            self._sensor,
            self.walls.at(x_m, y_m),
            self._corners.at(x_m, y_m),
            self._angles,
            self._ranges,
            self._hits,
            self._poses,
            self._echoes,
            self._noise,
        )
        first, second, third, fourth = self._echoes.tolist()
        return first, second, third, fourth


@compiled
@borrows
def fire_group(
    mounts: np.ndarray,
    x: float,
    y: float,
    theta: float,
    sensor: np.ndarray,
    segments: np.ndarray,
    corners: np.ndarray,
    angles: np.ndarray,
    ranges: np.ndarray,
    hits: np.ndarray,
    poses: np.ndarray,
    echoes: np.ndarray,
    noise: np.ndarray,
) -> None:
    """Fill `echoes` with the reports of up to four sonars that fire together."""
    n = len(mounts)
    cos, sin = math.cos(theta), math.sin(theta)
    for i in range(n):
        poses[i, 0] = x + cos * mounts[i, 0] - sin * mounts[i, 1]
        poses[i, 1] = y + sin * mounts[i, 0] + cos * mounts[i, 1]
        poses[i, 2] = theta + mounts[i, 2]
    for i in range(len(echoes)):
        echoes[i] = np.nan
    for i in range(n):
        echo = surface_echo(poses[i], sensor, segments, angles, ranges, hits)
        echo = corner_echo(poses[i], sensor, corners, angles, ranges, echo)
        for j in range(n):
            chance = sensor[0].crosstalk
            if j != i and chance > 0.0 and uniform(noise) < chance:
                echo = min(echo, foreign_echo(poses[i], poses[j], sensor, segments))
        echoes[i] = reading(echo, sensor, noise)


@compiled
@borrows
def surface_echo(
    pose: np.ndarray,
    sensor: np.ndarray,
    segments: np.ndarray,
    angles: np.ndarray,
    ranges: np.ndarray,
    hits: np.ndarray,
) -> float:
    """Return the nearest range of rays that do not meet their surface too flatly; inf if none."""
    p = sensor[0]
    cast_fan(pose[0], pose[1], pose[2], angles, p.max_range, segments, ranges, hits)
    echo = np.inf
    for i in range(len(angles)):
        if ranges[i] < echo:
            wall = segments[hits[i]]
            ex, ey = wall[2] - wall[0], wall[3] - wall[1]
            bearing = pose[2] + angles[i]
            across = abs(math.cos(bearing) * ey - math.sin(bearing) * ex)
            if across >= p.cos_incidence * math.hypot(ex, ey):
                echo = ranges[i]
    return echo


@compiled
@borrows
def corner_echo(
    pose: np.ndarray,
    sensor: np.ndarray,
    corners: np.ndarray,
    angles: np.ndarray,
    ranges: np.ndarray,
    echo: float,
) -> float:
    """Return the nearer of an echo and those of the concave corners in sight.

    A corner is in sight where the ray next to it reaches about as far as the corner.
    """
    p = sensor[0]
    n = len(angles)
    spacing = angles[1] - angles[0]
    for m in range(len(corners)):
        dx, dy = corners[m, 0] - pose[0], corners[m, 1] - pose[1]
        distance = math.hypot(dx, dy)
        if distance >= min(echo, p.max_range):
            continue
        off = bearing(pose, corners[m, 0], corners[m, 1])
        if abs(off) > p.half_beam:
            continue
        # Seen from between the arms u and v: -d = a u + b v with a and b positive.
        ux, uy, vx, vy = corners[m, 2], corners[m, 3], corners[m, 4], corners[m, 5]
        turn = ux * vy - uy * vx
        a = (-dx * vy + dy * vx) / turn
        b = (-ux * dy + uy * dx) / turn
        nearest = min(max(round((off - angles[0]) / spacing), 0), n - 1)
        if a > 0.0 and b > 0.0 and ranges[nearest] > 0.95 * distance - 0.01:
            echo = distance
    return echo


@compiled
@borrows
def foreign_echo(
    listener: np.ndarray, speaker: np.ndarray, sensor: np.ndarray, segments: np.ndarray
) -> float:
    """Return the range from another's sound, reflected by a wall; inf if none.

    The reflection must be in both cones and in sight of both.
    """
    p = sensor[0]
    found = np.inf
    for m in range(len(segments)):
        wall = segments[m]
        ex, ey = wall[2] - wall[0], wall[3] - wall[1]
        length = math.hypot(ex, ey)
        nx, ny = -ey / length, ex / length
        here = (listener[0] - wall[0]) * nx + (listener[1] - wall[1]) * ny
        there = (speaker[0] - wall[0]) * nx + (speaker[1] - wall[1]) * ny
        if here * there <= 0.0:
            continue
        # The source's image behind the wall, and where the line to it crosses the wall.
        image_x, image_y = speaker[0] - 2.0 * there * nx, speaker[1] - 2.0 * there * ny
        share = here / (here + there)
        qx = listener[0] + share * (image_x - listener[0])
        qy = listener[1] + share * (image_y - listener[1])
        along = ((qx - wall[0]) * ex + (qy - wall[1]) * ey) / length
        path = 0.5 * math.hypot(image_x - listener[0], image_y - listener[1])
        if along < 0.0 or along > length or path >= min(found, p.max_range):
            continue
        if not (in_cone(listener, qx, qy, p.half_beam) and in_cone(speaker, qx, qy, p.half_beam)):
            continue
        if blocked(listener[0], listener[1], qx, qy, segments):
            continue
        if not blocked(speaker[0], speaker[1], qx, qy, segments):
            found = path
    return found


@compiled
@borrows
def in_cone(pose: np.ndarray, x: float, y: float, half_beam: float) -> bool:
    """Whether a point is within a sonar's cone."""
    return abs(bearing(pose, x, y)) <= half_beam


@compiled
@borrows
def bearing(pose: np.ndarray, x: float, y: float) -> float:
    """Direction of a point from a pose, in (-π, π]."""
    dx, dy = x - pose[0], y - pose[1]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return math.atan2(cos * dy - sin * dx, cos * dx + sin * dy)


@compiled
@borrows
def reading(echo: float, sensor: np.ndarray, noise: np.ndarray) -> float:
    """Turn a true echo into a report: noise, drop-outs, outliers, limits, whole millimetres."""
    p = sensor[0]
    if p.dropout > 0.0 and uniform(noise) < p.dropout:
        return np.inf
    if p.outlier > 0.0 and uniform(noise) < p.outlier:
        # Half of them too short, half anywhere.
        far = min(echo, p.max_range) if uniform(noise) < 0.5 else p.max_range
        echo = p.min_range + uniform(noise) * max(far - p.min_range, 0.0)
    elif echo < np.inf:
        echo += (p.sigma + p.sigma_per_m * echo) * normal(noise)
    if echo > p.max_range:
        return np.inf
    return float(round(max(echo, p.min_range) * PER_M)) / PER_M
