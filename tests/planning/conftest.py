"""A small kinematic robot in a flat of two rooms, independent of firmware_sim."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import msgspec
import numpy as np
import pytest
from numba import njit  # type: ignore[import-untyped]

from robotctl.control.limiter import LimitsConfig
from robotctl.model.drives.drives import AckermannDrive, DifferentialDrive, Drive, TricycleDrive
from robotctl.model.drives.motion import integrate
from robotctl.model.geometry.se2 import SE2
from robotctl.model.geometry.twist import Twist
from robotctl.model.sensors.sonar import SonarMount
from robotctl.planning.config import NavigationConfig
from robotctl.planning.navigation_step import NavigationInputs
from robotctl.planning.navigator import Navigator


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


FLAT = np.array(
    box(0, 0, 8, 5)
    + box(4.95, 0, 5.05, 2)  # inner wall, the door from y = 2 to 3
    + box(4.95, 3, 5.05, 5)
    + box(0, 3.9, 0.6, 5)  # cabinet
    + box(7.2, 0, 8, 0.8)  # table
)
EMPTY = np.array(box(-50, -50, 50, 50))


def ring(front: float, back: float, side: float) -> tuple[SonarMount, ...]:
    middle = 0.5 * (front + back)
    return (
        SonarMount("front", front, 0.0, 0.0),
        SonarMount("front_left", front - 0.03, side - 0.05, 45.0),
        SonarMount("left", middle, side, 90.0),
        SonarMount("rear_left", back + 0.03, side - 0.05, 135.0),
        SonarMount("rear", back, 0.0, 180.0),
        SonarMount("rear_right", back + 0.03, 0.05 - side, -135.0),
        SonarMount("right", middle, -side, -90.0),
        SonarMount("front_right", front - 0.03, 0.05 - side, -45.0),
    )


@dataclass(frozen=True)
class Robot:
    """A drive with its body (front, rear, half-width about `base`) and sonars."""

    drive: Drive
    front: float
    rear: float
    side: float
    mounts: tuple[SonarMount, ...]

    @staticmethod
    def make(drive: Drive, front: float, rear: float, side: float) -> Robot:
        return Robot(drive, front, rear, side, ring(front, rear, side))


ROBOTS = {
    "differential": Robot.make(
        DifferentialDrive("differential", 0.3, 0.05, 2400), 0.18, -0.15, 0.15
    ),
    "tricycle": Robot.make(
        TricycleDrive("tricycle", "front", 0.32, 0.05, 0.6, 2.0, 2400), 0.38, -0.08, 0.15
    ),
    "ackermann": Robot.make(
        AckermannDrive("ackermann", 0.35, 0.26, 0.05, 0.6, 2.0, 2400), 0.43, -0.07, 0.15
    ),
}


@njit(cache=True)
def cast(walls, x, y, angles):
    """Return range and |cosine of incidence| of each ray from (x, y), (n, 2)."""
    hits = np.empty((len(angles), 2))
    for ray in range(len(angles)):
        ux, uy = math.cos(angles[ray]), math.sin(angles[ray])
        nearest, cosine = math.inf, 0.0
        for x0, y0, x1, y1 in walls:
            ex, ey, dx, dy = x1 - x0, y1 - y0, x0 - x[ray], y0 - y[ray]
            cross = ux * ey - uy * ex
            if cross == 0.0:
                continue
            along, share = (dx * ey - dy * ex) / cross, (dx * uy - dy * ux) / cross
            if 0.0 < along < nearest and 0.0 <= share <= 1.0:
                nearest, cosine = along, abs(cross) / math.hypot(ex, ey)
        hits[ray] = nearest, cosine
    return hits


@njit(cache=True)
def crosses(walls, x, y, theta, rear, front, side):
    """Return whether a wall crosses the rectangle of a body at a pose (Liang-Barsky)."""
    c, s = math.cos(theta), math.sin(theta)
    for x0, y0, x1, y1 in walls:
        first, last = 0.0, 1.0
        ends = (
            (c * (x0 - x) + s * (y0 - y), c * (x1 - x0) + s * (y1 - y0), rear, front),
            (c * (y0 - y) - s * (x0 - x), c * (y1 - y0) - s * (x1 - x0), -side, side),
        )
        for begin, along, low, high in ends:
            if along != 0.0:
                a, b = (low - begin) / along, (high - begin) / along
                first, last = max(first, min(a, b)), min(last, max(a, b))
            elif not low <= begin <= high:
                last = -1.0
        if first <= last:
            return True
    return False


@dataclass
class World:
    """One robot among walls; `odometry` is what it believes, `pose` is the truth."""

    robot: Robot
    walls: np.ndarray
    pose: SE2
    rng: np.random.Generator
    drift: float = 0.0  # m per sqrt(m) and rad per sqrt(m)
    range_noise_m: float = 0.0
    outliers: float = 0.0
    most_incidence_deg: float = 65.0
    twist: Twist = field(default_factory=lambda: Twist(0.0, 0.0))
    steering: float = 0.0
    odometry: SE2 = field(init=False)
    touched: int = 0
    distance_m: float = 0.0
    obstacle: np.ndarray | None = None

    def __post_init__(self) -> None:
        self.odometry = self.pose

    def all_walls(self) -> np.ndarray:
        return self.walls if self.obstacle is None else np.vstack([self.walls, self.obstacle])

    def drive(self, v_ref: float, omega_ref: float, dt: float) -> None:
        """Follow the set-point with limited acceleration and steering rate."""
        v = self._slew(self.twist.v_m_s, v_ref, 2.0 * dt)
        drive = self.robot.drive
        if drive.steered:
            wanted = drive.inverse(Twist(v_ref, omega_ref), (self.steering,)).joints_rad[0]
            self.steering = self._slew(self.steering, wanted, 2.0 * dt)
            curvature = math.tan(self.steering) / drive.wheelbase_m
            self.twist = Twist(v, v * curvature)
        else:
            self.twist = Twist(v, self._slew(self.twist.omega_rad_s, omega_ref, 6.0 * dt))
        self.pose = integrate(self.pose, self.twist, dt)
        step = abs(v) * dt
        self.distance_m += step
        noise = self.drift * math.sqrt(step) * self.rng.standard_normal(2)
        believed = Twist(float(v + noise[0] / dt), float(self.twist.omega_rad_s + noise[1] / dt))
        self.odometry = integrate(self.odometry, believed, dt)

    @staticmethod
    def _slew(value: float, target: float, change: float) -> float:
        return min(max(target, value - change), value + change)

    def check_contact(self) -> None:
        r = self.robot
        if crosses(self.all_walls(), *msgspec.structs.astuple(self.pose), r.rear, r.front, r.side):
            self.touched += 1

    def ranges(self) -> tuple[float, ...]:
        """One reading of each sonar: nearest wall in a cone of 24 degrees, met not too flatly."""
        mounts = self.robot.mounts
        places = np.array([self.pose.apply(mount.x_m, mount.y_m) for mount in mounts])
        axes = self.pose.theta_rad + np.array([mount.heading_rad for mount in mounts])
        rays = axes[:, None] + np.radians([-12.0, -6.0, 0.0, 6.0, 12.0])
        x, y = np.repeat(places, 5, axis=0).T
        hits = cast(self.all_walls(), x, y, rays.ravel())
        seen = np.where(
            hits[:, 1] > math.cos(math.radians(self.most_incidence_deg)), hits[:, 0], np.inf
        )
        readings = seen.reshape(-1, 5).min(axis=1)
        readings += self.range_noise_m * self.rng.standard_normal(len(mounts))
        wild = self.rng.random(len(mounts)) < self.outliers
        readings = np.where(wild, self.rng.uniform(0.03, 4.0, len(mounts)), readings)
        readings = np.where(readings > 4.0, np.inf, np.maximum(readings, 0.02))
        return tuple(readings.tolist())


@dataclass
class Run:
    """A navigator driving in a world at 20 Hz, with 100 Hz motion."""

    world: World
    navigator: Navigator
    now_ns: int = 0
    enabled: bool = True
    messages: list[str] = field(default_factory=list)
    trace: list[SE2] = field(default_factory=list)
    charge: float = math.nan  # of the battery
    markers: tuple = ()  # that the camera sees in this step
    found: int = 0  # how often the localiser found the robot elsewhere

    def jump(self, to: SE2) -> None:
        """Carry the robot away; the localiser finds it at once."""
        self.world.pose = self.world.odometry = to
        self.found += 1

    def step(self, *requests):
        inputs = NavigationInputs(
            self.world.odometry,
            self.world.twist,
            self.world.ranges(),
            (self.now_ns,) * len(self.world.robot.mounts),
            self.enabled,
            requests,
            epoch=(0, self.found),
            charge=self.charge,
            markers=self.markers,
        )
        out = self.navigator.step(inputs, self.now_ns)
        if not self.messages or self.messages[-1] != out.state.message:
            self.messages.append(out.state.message)
        for _ in range(5):
            self.world.drive(out.v_m_s, out.omega_rad_s, 0.01)
        self.world.check_contact()
        self.trace.append(self.world.pose)
        self.now_ns += 50_000_000
        return out

    def until(self, condition, seconds: float):
        """Step until `condition(outputs)`; fail after `seconds` of simulated time."""
        deadline = self.now_ns + int(seconds * 1e9)
        while self.now_ns < deadline:
            out = self.step()
            if condition(out):
                return out
        raise AssertionError(f"not within {seconds} s; messages: {self.messages[-5:]}")


@pytest.fixture(params=list(ROBOTS))
def robot(request) -> Robot:
    """Return each of the three drives in turn."""
    return ROBOTS[request.param]


@pytest.fixture(params=["tricycle", "ackermann"])
def steered(request) -> Robot:
    """Return each drive-and-steer robot in turn."""
    return ROBOTS[request.param]


@pytest.fixture
def differential() -> Robot:
    """Return the differential robot."""
    return ROBOTS["differential"]


@pytest.fixture
def make_run():
    """Return a function that puts a robot into a world: `make_run(robot, start=..., ...)`."""

    def make(robot, start=None, mission=None, config=None, flat=True, seed=1, **world):
        start = start or (mission.start.pose if mission else SE2())
        rng = np.random.default_rng(seed)
        place = World(robot, FLAT if flat else EMPTY, start, rng, **world)
        navigator = Navigator(
            config or NavigationConfig(),
            robot.drive,
            LimitsConfig(0.8, 2.5, 2.5, 8.0, 30.0, 100.0),
            robot.mounts,
            mission,
            start,
            sees_markers=True,
        )
        return Run(place, navigator)

    return make
