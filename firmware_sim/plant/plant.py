"""The robot's body, motors and battery in the room.

The state is the truth; only the encoders' counts, whole numbers, are measurements.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_sim.config.config import RobotConfig
from firmware_sim.errors import SimulationError
from firmware_sim.noise import noise_state
from firmware_sim.plant.axis import Axis, BrakeResistor
from firmware_sim.plant.battery import open_circuit_voltage
from firmware_sim.plant.contact import contact_rows, press
from firmware_sim.plant.discs import nearest_point
from firmware_sim.plant.plant_state import BODY, DT_S, axis_records, constants, places
from firmware_sim.plant.plant_step import run_plant
from firmware_sim.plant.walls import END, body_outline, wall_grid
from firmware_sim.world.world import World

STEP_NS = round(DT_S * 1e9)
"""Length of one step of the plant [ns]."""
_PLACES_TRIED = 3000


_X, _Y, _THETA, _VX, _VY, _OMEGA, _STEERING, _STEERING_CMD = places(
    BODY, "x", "y", "theta", "vx", "vy", "omega", "steering", "steering_cmd"
)
_BUS_V, _BATTERY_A, _CHARGE, _DISTANCE = places(BODY, "bus_v", "battery_a", "charge", "distance")
_RESISTOR_A = next(places(BODY, "resistor_a"))


class Plant:
    """A robot in a room, advanced in steps of 1 ms.

    Starts at rest at the world's start pose with the bridges open.

    Parameters
    ----------
    config
        The robot.
    world
        The room.
    rng
        Seeds the roughness of the floor. The same seed and commands give the same motion, bit for
        bit, on the same machine.

    Attributes
    ----------
    axes
        Driven wheels with their motors, in the order of `config.drive.wheel_names`.
    body_state
        Number of the body's present state.
    discs
        Centres in world and radii, (n, 3) [m], of further, possibly moving, obstacles.

    Raises
    ------
    SimulationError
        If the robot cannot stand at its start.
    """

    def __init__(self, config: RobotConfig, world: World, rng: np.random.Generator) -> None:
        s, chassis = config.simulation, config.drive.chassis(config.simulation)
        self._p = constants(config, chassis)
        self._chassis = chassis
        self._world = world
        self._segments = world.touchable
        bodies = config.bodies
        self._outlines = [body_outline(pieces) for pieces in bodies]
        self.use_body(config.body.state or 0)
        corner, self._grid = wall_grid(self._segments, float(self._p["reach"][0]))
        self._p["grid_x"], self._p["grid_y"] = corner
        self._rows = contact_rows(chassis, self._p, max(map(len, bodies)))
        self._noise = noise_state(rng)
        self.discs = np.empty((0, 3))
        self._body = np.zeros(1, BODY)
        self._b = self._body[0]
        # Views for hot-path access, at a fifth of a record's cost.
        self._body_numbers: memoryview[float] = self._body.data.cast("B").cast("d")
        self._records = axis_records(config, chassis)
        self.axes = tuple(
            Axis(k, name, self._records[k : k + 1], s)
            for k, name in enumerate(config.drive.wheel_names)
        )
        self._steering_max_rad = float(self._p["steering_max"][0])
        self._com_x_m = float(self._p["com_x"][0])
        self._com_y_m = float(self._p["com_y"][0])
        self._start(config)
        self._begin_at(*world.start)

    def _start(self, config: RobotConfig) -> None:
        """Set the battery to its state at power-on."""
        battery = config.simulation.battery
        self._b["charge"] = battery.charge
        self._b["battery_a"] = battery.electronics_current_a
        source = float(self._p["cells_scale"][0]) * open_circuit_voltage(battery.charge)
        self._b["bus_v"] = source - battery.internal_resistance_ohm * self.battery_current_a

    def warm(self) -> None:
        """Compile, or load from the cache, the functions of `step`; changes nothing."""
        self.step(0)

    def steer(self, angle_rad: float) -> None:
        """Demand an angle of the steering servo [rad], positive left.

        It is limited to the range of the linkage.

        Raises
        ------
        ValueError
            If the angle is not finite.
        """
        limit = self._steering_max_rad
        if not -limit <= angle_rad <= limit:
            if not math.isfinite(angle_rad):
                raise ValueError(f"steer: angle {angle_rad}")
            angle_rad = math.copysign(limit, angle_rad)
        self._body_numbers[_STEERING_CMD] = angle_rad

    def use_body(self, state: int) -> None:
        """Change the body to a state, by its number in the file."""
        self.body_state, self._outline = state, self._outlines[state]

    def fit_brake_resistor(self, resistor: BrakeResistor | None) -> None:
        """Connect a brake resistor to the rail, or disconnect it."""
        self._b["resistor_ohm"], self._b["resistor_v"] = resistor or (0.0, 0.0)

    def step(self, n: int = 1) -> None:
        """Advance by n milliseconds."""
        run_plant(
            n,
            self._body,
            self._records,
            self._p,
            self._outline,
            self._segments,
            self._grid,
            self._rows,
            self._noise,
            self.discs,
        )

    def _begin_at(self, x_m: float, y_m: float, theta_rad: float) -> None:
        """Put the robot at its start; raises SimulationError that names the nearest free place."""
        low_x, low_y, high_x, high_y = self._world.bounds
        try:
            if not (low_x <= x_m <= high_x and low_y <= y_m <= high_y):
                raise SimulationError(
                    f"the start at x {x_m} m, y {y_m} m lies outside {self._world.name}: allowed "
                    f"are x {low_x:g}..{high_x:g} m, y {low_y:g}..{high_y:g} m"
                )
            self.place(x_m, y_m, theta_rad)
        except SimulationError as error:
            raise SimulationError(f"{error}; {self._nearest_place(x_m, y_m, theta_rad)}") from error

    def place(self, x_m: float, y_m: float, theta_rad: float) -> None:
        """Move the robot, at rest; counts and distance continue.

        Raises
        ------
        SimulationError
            If a wall is in the way.
        """
        if obstacle := self._obstacle(x_m, y_m, theta_rad):
            raise SimulationError(
                f"the robot cannot stand at x {x_m} m, y {y_m} m, heading {theta_rad} rad: "
                f"{obstacle} is in the way"
            )
        b = self._b
        b["x"], b["y"], b["theta"] = x_m, y_m, theta_rad
        b["vx"] = b["vy"] = b["omega"] = b["touch_s"] = b["contacts"] = 0.0
        self._records["omega"] = 0.0

    def _obstacle(self, x_m: float, y_m: float, theta_rad: float) -> str:
        """Name of the obstacle to placing the robot somewhere; "" if none."""
        if inside := self._world.solid_at(x_m, y_m):
            return inside
        pieces = np.split(self._outline, np.unique(self._outline[:, END])[:-1].astype(int))
        touches = any(_overlaps(each, self._segments, x_m, y_m, theta_rad) for each in pieces)
        return "a wall" if touches else ""

    def _nearest_place(self, x_m: float, y_m: float, theta_rad: float) -> str:
        """Describe the nearest place where the robot can stand with this heading."""
        for place in self._world.places(x_m, y_m)[:_PLACES_TRIED].tolist():
            x, y = (round(each, 2) for each in place)
            if not self._obstacle(x, y, theta_rad):
                return f"the nearest place for it with this heading is x {x} m, y {y} m"
        return "there is no place for it near by either"

    def contact(
        self, place: tuple[float, float], radius_m: float, motion: tuple[float, float, float]
    ) -> tuple[float, float]:
        """Return the gap to a disc [m], and the speed of the outline there towards it [m/s].

        `motion` is forward and lateral speed of base [m/s] and yaw rate [rad/s].
        """
        body = self._body_numbers
        cos, sin = math.cos(body[_THETA]), math.sin(body[_THETA])
        off_x, off_y = place[0] - body[_X], place[1] - body[_Y]
        x, y = cos * off_x + sin * off_y, -sin * off_x + cos * off_y
        distance, near_x, near_y = nearest_point(x, y, self._outline)
        v, lateral, omega = motion
        towards = (v - omega * near_y) * (x - near_x) + (lateral + omega * near_x) * (y - near_y)
        return distance - radius_m, towards / distance if distance != 0.0 else 0.0

    @property
    def motion(self) -> tuple[float, float, float]:
        """Forward and lateral speed of base [m/s] and yaw rate [rad/s]."""
        body = self._body_numbers
        omega_rad_s = body[_OMEGA]
        return (
            body[_VX] + omega_rad_s * self._com_y_m,
            body[_VY] - omega_rad_s * self._com_x_m,
            omega_rad_s,
        )

    def loosen(self, wheel: int, grip: float) -> None:
        """Reduce the grip of a wheel's tyre, by number, to a share: a fault."""
        for row, each in zip(self._rows, self._chassis.grips, strict=False):
            if each.wheel == wheel:
                press(row, grip * each.load_n, self._p)

    @property
    def powered(self) -> bool:
        """Whether a bridge may drive its motor."""
        for axis in self.axes:  # noqa: SIM110 - asked each 5 ms; any() would make a generator
            if axis.powered:
                return True
        return False

    @property
    def bus_voltage_v(self) -> float:
        """Voltage of the rail that feeds all bridges [V]."""
        return self._body_numbers[_BUS_V]

    @property
    def battery_current_a(self) -> float:
        """Current out of the battery [A]; negative charges."""
        return self._body_numbers[_BATTERY_A]

    @property
    def brake_resistor_a(self) -> float:
        """Current through the brake resistor [A]."""
        return self._body_numbers[_RESISTOR_A]

    @property
    def charge(self) -> float:
        """State of charge in [0, 1]."""
        return self._body_numbers[_CHARGE]

    @charge.setter
    def charge(self, value: float) -> None:
        self._b["charge"] = min(max(value, 0.0), 1.0)

    @property
    def steering_rad(self) -> float:
        """Angle of the steering servo, or of a car's virtual centre wheel [rad], positive left."""
        return self._body_numbers[_STEERING]

    @property
    def x_m(self) -> float:
        """True x of base in world [m]."""
        return self._body_numbers[_X]

    @property
    def y_m(self) -> float:
        """True y of base in world [m]."""
        return self._body_numbers[_Y]

    @property
    def theta_rad(self) -> float:
        """True heading [rad], in (-π, π]."""
        return -math.remainder(-self._body_numbers[_THETA], 2.0 * math.pi)

    @property
    def v_m_s(self) -> float:
        """True forward speed of base [m/s]."""
        return self.motion[0]

    @property
    def vy_m_s(self) -> float:
        """True sideways speed of base [m/s], positive left."""
        return self.motion[1]

    @property
    def omega_rad_s(self) -> float:
        """True yaw rate [rad/s]."""
        return self._body_numbers[_OMEGA]

    @property
    def collisions(self) -> int:
        """Collisions since power-on; contacts that follow within 0.3 s are one."""
        return int(self._b["collisions"])

    @property
    def touching(self) -> bool:
        """Whether the robot touches a wall, or did within the last 0.3 s."""
        return float(self._b["touch_s"]) > 0.0

    @property
    def impact_m_s(self) -> float:
        """Speed towards the wall at the start of the last collision [m/s]."""
        return float(self._b["impact_m_s"])

    @property
    def distance_m(self) -> float:
        """Length of the base's path since power-on [m]."""
        return self._body_numbers[_DISTANCE]


def _overlaps(outline: np.ndarray, segments: np.ndarray, x: float, y: float, theta: float) -> bool:
    """Whether a piece of the outline at a pose touches a wall: separating axes of convex shapes."""
    if len(segments) == 0:
        return False
    c, s = math.cos(theta), math.sin(theta)
    relative = segments - np.array([x, y, x, y])
    ends = np.stack(
        [
            np.stack([c * relative[:, i] + s * relative[:, i + 1] for i in (0, 2)], axis=1),
            np.stack([-s * relative[:, i] + c * relative[:, i + 1] for i in (0, 2)], axis=1),
        ],
        axis=2,
    )
    apart = np.zeros(len(segments), dtype=bool)
    for vx, vy, nx, ny in outline[:, :4]:
        gap = (ends[:, :, 0] - vx) * nx + (ends[:, :, 1] - vy) * ny
        apart |= np.min(gap, axis=1) > 0.0
    side = ends[:, 1] - ends[:, 0]
    normal = np.stack([-side[:, 1], side[:, 0]], axis=1)
    across = (outline[None, :, :2] - ends[:, None, 0]) @ normal[:, :, None]
    apart |= (np.min(across[:, :, 0], axis=1) > 0.0) | (np.max(across[:, :, 0], axis=1) < 0.0)
    return bool(np.any(~apart))
